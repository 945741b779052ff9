//! The stage: a MuJoCo world with a keyboard, fences, an Allegro hand on a rail, and the controllers of its joints.
//!
//! [`World`] is stepped one control step at a time with thirteen joint targets and gives back joints, fingertips and
//! keys. What may vary about its physics is in [`PhysicalParams`]; what kind of world it is in [`StageConfig`].
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
pub mod geometry;
pub mod hand;
pub mod kinematics;
mod mjcf;
pub mod params;
mod picture;
mod scene;
mod snapshot;
mod world;

pub use config::{Cone, Integrator, KeyFactors, ModelOptions, PHYSICS_STEPS, StageConfig};
pub use controller::Actuation;
pub use hand::{FINGERS, JOINT_NAMES, JOINTS, RAIL, Side};
pub use mjcf::mjcf;
pub use params::{ParamError, PhysicalParams};
pub use picture::{LARGEST_PICTURE, Painter, PictureError, View, picture_size};
pub use scene::{Scene, SceneBody, SceneGeom, SceneJoint};
pub use snapshot::{Snapshot, SnapshotError};
pub use world::{StageError, StepOutcome, World, joint_range, mujoco_version};
