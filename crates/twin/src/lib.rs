//! The twin: an emulated robot. Its devices are those of `etude-emulators`, which use the same
//! bytes as the real ones. They are moved by a MuJoCo world with its own [`TwinParams`], which has
//! shorter steps than the simulator and is hidden from the controller.
//!
//! [`Lockstep`] lets a controller and a twin run against each other without sockets or clocks;
//! [`TwinServer`] puts a twin on sockets, by the wall clock.

mod backlash;
mod drives;
mod error;
mod hidden_params;
mod keys;
mod lockstep;
mod mount;
mod params;
mod random;
mod server;
mod twin;

pub use error::TwinParamsError;
pub use etude_emulators::ArmPorts;
pub use etude_emulators::faults::{FaultError, FaultKind, OrderedFault};
pub use hidden_params::STEP;
pub use lockstep::Lockstep;
pub use params::TwinParams;
pub use server::{ServeError, TwinServer};
pub use twin::{ARM_SERIAL, SHOWN_KEYS, Twin, TwinError, calibration, stage_side};
