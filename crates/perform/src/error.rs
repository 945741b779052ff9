//! Why a performance fails.

use etude_robot::Refused;
use etude_task::TaskError;

use crate::recording::RecordingError;

/// A performance failed.
#[derive(Debug, thiserror::Error)]
pub enum PerformError {
    /// The task could not be built.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The robot refused a command.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// The robot did not start, or did not reach its starting pose.
    #[error("the robot did not get ready: {0}")]
    NotReady(String),
    /// It was interrupted before the robot was ready.
    #[error("interrupted before the robot was ready")]
    Interrupted,
    /// The recording could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}
