//! The twin: a robot that is not there. Its devices are those of `etude-emulators`, which speak the same bytes as the
//! real ones; what moves them is a MuJoCo world with a [`Truth`] of its own, finer in time than the simulator and unknown
//! to whoever plays on it.
//!
//! [`Lockstep`] lets a controller and a twin run against each other without sockets or clocks; [`TwinServer`] puts a twin
//! on sockets, by the wall clock.

mod drives;
mod error;
mod keys;
mod lockstep;
mod numbers;
mod server;
mod truth;
mod twin;

pub use error::TruthError;
pub use etude_emulators::ArmPorts;
pub use etude_emulators::faults::{FaultError, FaultKind, OrderedFault};
pub use lockstep::Lockstep;
pub use numbers::STEP;
pub use server::{ServeError, TwinServer};
pub use truth::Truth;
pub use twin::{ARM_SERIAL, SHOWN_KEYS, Twin, TwinError, calibration, stage_side};
