//! Why a performance or its recording fails.

use std::path::PathBuf;

use etude_robot::Refused;
use etude_task::TaskError;

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

/// A recording could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be created, opened or read.
    #[error("cannot open the recording {path}: {source}; check the path and its permissions")]
    Open {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Writing failed, for example because the disk is full.
    #[error("cannot write the recording {path}: {message}; what was written until then can be read")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// The file is no recording of ours.
    #[error("{path} is not a recording of Étude: {message}")]
    Format {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
}
