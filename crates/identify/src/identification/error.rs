//! Why an identification failed.

use etude_perform::FileError;
use etude_stage::{ParamError, StageError};

use crate::error::FitError;

/// An identification failed.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The simulation cannot be built.
    #[error(transparent)]
    Pass(#[from] StageError),
    /// A start value is out of range.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// A group cannot be fitted, or its result has no uncertainty.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The state cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The state cannot be written as JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// The state cannot be read, or belongs to another identification.
    #[error("{0}; remove it, or choose another folder with -o, to start again")]
    State(String),
    /// There is nothing to fit.
    #[error("no joint moves in the recordings; record an excitation (`etude record --excitation chirp`)")]
    Nothing,
    /// The job was interrupted; the state is saved.
    #[error("interrupted; the same command resumes the fit")]
    Interrupted,
}
