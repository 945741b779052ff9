//! The xArm7 over TCP: its protocol, its kinematics and its driver.
//!
//! Sources: the private TCP protocol, reports, states and kinematics in `ufactory_docs`
//! (<https://github.com/xArm-Developer/ufactory_docs>), the xArm user manual, and xArm-Python-SDK
//! 1.18.4 and xArm-CPLUS-SDK (<https://github.com/xArm-Developer>).
//!
//! Unlike the official SDK, the driver never looks for a Unix socket in place of the arm's address:
//! another program listening there would silently replace the robot.

pub mod codec;
mod delay_monitor;
pub mod driver;
pub mod errors;
mod firmware;
mod framing;
pub mod kinematics;
mod link;
mod pose;
pub mod report;
mod safety_box;
mod stopper;
pub mod tcp;

pub(crate) use driver::largest_turn;
pub use driver::{Arm, ArmConfig, ArmError, ArmFault, ArmState, ArmVersion, TargetError};
pub use firmware::tried_firmware;
pub(crate) use firmware::untried;
pub use link::LinkSpeed;
pub(crate) use safety_box::flange_positions;
pub use safety_box::{OutsideBox, SafetyBox};
pub use stopper::Stopper;
pub use tcp::{ArmCommands, ArmConnection, ArmLinkError, device};
