//! The report of an identification: what was fitted, how well the simulator repeats the robot, and which numbers to trust.
//!
//! [`Report`] is Markdown with figures.

mod advice;
mod build;
mod correlation;
mod directions;
mod document;
mod errors;
mod held;
mod input;
mod number;
mod overlay;
mod parameters;
mod remaining;
mod summary;
mod unexplained;

#[cfg(test)]
mod tests;

pub use document::{Curve, Figure, Report};
pub use input::ReportInput;
