//! Why a task cannot be built.

use etude_music::SongError;
use etude_stage::{ParamError, StageError};

/// A task could not be built.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// The world could not be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// A physical number is unknown or out of range.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// The song cannot be played here.
    #[error(transparent)]
    Song(#[from] SongError),
    /// A value of the configuration cannot be used.
    #[error("{0}")]
    Value(String),
}
