//! An emulated arm and its controller, which answer and report with the same bytes as the real
//! ones.
//!
//! The behaviour follows the sources that `etude_robot::xarm` names. Where they say nothing, the
//! behaviour that is harder for a driver was chosen. What our driver does not use follows
//! xarm-python-sdk 1.18.4, whose calls all get an answer; `docs/robot.md` lists what differs from a
//! real controller.

mod answers;
mod emulator;
mod inputs;
mod lines;
mod motion;
mod moves;
mod report;
mod server;
mod setting_registers;
mod settings;
mod state;

pub use emulator::{ArmEmulator, ArmEmulatorConfig};
pub use server::{ArmPorts, ArmServer};
pub use state::{ConnectionId, ReportKind};
