//! The xArm7 over TCP: what its controller says and understands, where its flange is, and its driver.
//!
//! The driver never looks for Unix sockets, as the official SDK does: whatever listens there would silently
//! take the place of the robot (fact sheet hardware §2.11).

pub mod codec;
mod details;
pub mod driver;
pub mod errors;
mod fence;
mod framing;
pub mod kinematics;
mod pose;
pub mod report;
mod stopper;
pub mod tcp;

pub use driver::{Arm, ArmConfig, ArmCounters, ArmError, ArmFault, ArmState, ArmVersion, TargetError};
pub use fence::{Fence, OutsideFence};
pub use stopper::Stopper;
pub use tcp::{ArmCommands, ArmConnection, ArmLinkError};
