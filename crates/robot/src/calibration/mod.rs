//! Where the keyboard stands before the arm, and with it the way from the policy's one rail to seven joint angles.
//!
//! An operator guides the hand to three keys and each time the arm's pose is kept: the paper's C1, C3 and C5. Between
//! them the flange moves on straight lines with a fixed orientation (fact sheet "hardware" §0).

mod file;
mod path;

pub use file::{Calibration, CalibrationError, Point};
pub use path::{RailPath, RailPlace};
