//! The report of an identification: what was fitted, how well the simulator repeats the robot, and
//! which numbers to trust.
//!
//! [`Report`] is Markdown with figures.

mod advice;
mod build;
mod correlation;
mod directions;
mod document;
mod error_decomposition;
mod errors;
mod input;
mod number;
mod overlay;
mod parameters;
mod remaining_error;
mod summary;

#[cfg(test)]
mod tests;

pub use document::{Curve, Figure, Report};
pub use input::ReportInput;
