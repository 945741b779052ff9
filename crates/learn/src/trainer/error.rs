//! Errors of a training, with what to do.

use std::path::PathBuf;

use crate::{config::ConfigError, env::EnvironmentError, files::FileError};

/// Why a training could not start or continue. The last checkpoint, if there is one, is always
/// intact.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A configured value cannot work.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The environment refused its saved state.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// It does not fit the folder, the checkpoint or the machine. The text says why, and what to
    /// do.
    #[error("{0}")]
    Refused(String),
    /// The folder holds no training.
    #[error("{} holds no checkpoint to resume from: start a training there first", folder.display())]
    NothingToResume {
        /// The run folder.
        folder: PathBuf,
    },
    /// A number is not finite.
    #[error(
        "{what} is not a finite number at environment step {step}: start a training with lower learning rates, or check the environment \
         at that step; resuming from the last checkpoint leads to the same error"
    )]
    NotFinite {
        /// What was found.
        what: String,
        /// Environment steps so far.
        step: u64,
    },
}
