//! Why an identification failed.

use etude_perform::FileError;
use etude_stage::{ParamError, StageError};

use crate::config::ConfigError;
use crate::estimate::EstimateError;
use crate::fit::TellError;
use crate::group::GroupError;
use crate::jacobian::JacobianError;

/// An identification failed.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// The simulation cannot be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// The simulation cannot be built for a replay.
    #[error("cannot build the simulation: {0}")]
    Replay(String),
    /// A start value is out of range.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// The method's configuration is invalid.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A group cannot be fitted.
    #[error(transparent)]
    Group(#[from] GroupError),
    /// Evaluations do not match the candidates: a bug.
    #[error(transparent)]
    Tell(#[from] TellError),
    /// The uncertainty of the result cannot be computed.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
    /// The Jacobian of the result cannot be computed.
    #[error(transparent)]
    Jacobian(#[from] JacobianError),
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
