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
    /// No reward term has this name.
    #[error("no reward term is called `{name}`; there are: {known}")]
    UnknownTerm {
        /// The unknown name.
        name: String,
        /// The names that there are.
        known: String,
    },
    /// A weight is not a number.
    #[error("the weight of reward term `{0}` is {1}; it must be a finite number")]
    BadWeight(String, f64),
    /// A half-width of the randomisation is not a number of at least 0.
    #[error(
        "task.randomisation.widths: {0} = {1} must be a finite number of at least 0, in the unit of the row; \
         `etude model params` lists the rows"
    )]
    BadWidth(String, f64),
    /// A number of the task itself is out of range.
    #[error("task.{name} = {value} must lie in {low} … {high}")]
    OutOfRange {
        /// Key of the config.
        name: &'static str,
        /// Refused value.
        value: f64,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
}
