//! Errors of twin parameters.

use std::path::PathBuf;

use etude_checks::RangeError;
use etude_emulators::faults::{FaultError, FaultPlanError};
use etude_stage::ParamError;

/// A parameter set that no twin can have.
#[derive(Debug, thiserror::Error)]
pub enum TwinParamsError {
    /// The file cannot be read.
    #[error("cannot read the twin parameters {path}: {message}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// The text does not describe twin parameters.
    #[error("these are not valid twin parameters: {0}; configs/twin-params has examples")]
    Text(String),
    /// The seed of a parameter set that is drawn is not one.
    #[error("there are no twin parameters `{0}`: its seed is a whole number from 0 to {max}, as in `random:7`", max = u32::MAX)]
    Seed(String),
    /// A physical number is unknown or out of range.
    #[error("the twin's physics: {0}")]
    Physics(#[from] ParamError),
    /// A number is out of its range.
    #[error("the twin's {0}")]
    Setting(#[from] RangeError),
    /// The faults of a link are not valid.
    #[error("the twin's links: {0}")]
    Link(#[from] FaultPlanError),
    /// An ordered fault is not valid.
    #[error("the twin's faults: {0}")]
    Fault(#[from] FaultError),
}
