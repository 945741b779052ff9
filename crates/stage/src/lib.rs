//! The stage: a MuJoCo world with a keyboard, fences, an Allegro hand on a rail, and the
//! controllers of its joints.
//!
//! [`World`] advances by one control step with thirteen joint targets; joints, fingertips and keys
//! can then be read. Physical parameters that may vary are in [`PhysicalParams`], the choice of
//! hand, fences and actuation in [`StageConfig`].
//!
//! ```
//! use etude_stage::{PhysicalParams, StageConfig, World};
//!
//! let mut world = World::new(&StageConfig::default(), &PhysicalParams::default())?;
//! let targets = world.start_pose();
//! let outcome = world.step(&targets);
//! assert!(world.pressed().is_empty() && !outcome.collided);
//! # Ok::<(), etude_stage::StageError>(())
//! ```

mod config;
mod contacts;
pub mod controller;
mod error;
pub mod geometry;
pub mod hand;
pub mod kinematics;
mod mjcf;
pub mod params;
mod picture;
mod scene;
mod strike;
mod visual_geoms;
mod world;

pub use config::{Cone, Integrator, KeyFactors, ModelOptions, PHYSICS_STEPS, StageConfig};
pub use controller::Actuation;
pub use error::StageError;
pub use hand::{DRIVEN_JOINTS, FINGERS, JOINT_NAMES, RAIL, Side, joint_range};
pub use mjcf::{MAX_PICTURE_SIZE, mjcf};
pub use mujoco_rs::mujoco_version;
pub use params::{ParamError, PhysicalParams};
pub use picture::{Painter, PictureError, View, picture_size};
pub use scene::{Scene, SceneBody, SceneGeom, SceneJoint};
pub use strike::{LOUDEST_SECS, SOFTEST_SECS, Strike, strike_velocity};
pub use visual_geoms::{FLANGE_END, RAIL_BEAM};
pub use world::{MAX_AHEAD_M, Snapshot, SnapshotError, StepOutcome, World, drag_ways_m};
