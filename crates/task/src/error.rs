//! Why a task cannot be built.

use etude_checks::RangeError;
use etude_music::SongError;
use etude_stage::{ParamError, StageError};

/// A task could not be built.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// The world could not be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// A physical parameter is unknown or out of range.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// A setting is out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// The song cannot be played here.
    #[error(transparent)]
    Song(#[from] SongError),
    /// A value of the configuration cannot be used.
    #[error("{0}")]
    Value(String),
}
