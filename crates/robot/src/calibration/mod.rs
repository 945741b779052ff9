//! Where the keyboard stands relative to the arm, and the mapping from the policy's rail position
//! to seven joint angles.
//!
//! An operator guides the hand to three keys, and the arm's pose at each is stored: the paper's C1,
//! C3 and C5. Between them the flange moves on straight lines with a fixed orientation
//! (lasr-lab/learning-to-play-piano).

mod file;
mod path;

#[cfg(test)]
pub(crate) use file::papers;
pub use file::{Calibration, CalibrationError, Point};
pub use path::{RailPath, RailPlace};
