//! Errors of a training, with what to do.

use std::path::PathBuf;

use crate::{config::ConfigError, env::EnvironmentError, files::FileError};

/// Why a training could not start or continue. The last checkpoint, if there is one, is always intact.
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
    /// The folder holds a training already.
    #[error("{} holds a training already: resume it, or choose another folder", folder.display())]
    AlreadyStarted {
        /// The run folder.
        folder: PathBuf,
    },
    /// The folder holds the results of a training that cannot be continued.
    #[error(
        "{} holds a training without its checkpoint, which can be played but not continued: choose another folder, or delete it",
        folder.display()
    )]
    CheckpointGone {
        /// The run folder.
        folder: PathBuf,
    },
    /// The folder holds no training.
    #[error("{} holds no checkpoint to resume from: start a training there first", folder.display())]
    NothingToResume {
        /// The run folder.
        folder: PathBuf,
    },
    /// The checkpoint belongs to another training.
    #[error(
        "this checkpoint was made with {what} = {saved}, not {given}: resume with the saved value, or start a new training"
    )]
    Mismatch {
        /// What differs.
        what: &'static str,
        /// The checkpoint's.
        saved: String,
        /// The caller's.
        given: String,
    },
    /// The networks of a warm start have another shape.
    #[error(
        "the networks in {} do not fit this training: they have {theirs}, this training has {ours}; use the same configuration, or \
         start without them", origin.display()
    )]
    OtherForm {
        /// The policy or the run.
        origin: PathBuf,
        /// What it has.
        theirs: String,
        /// What the training has.
        ours: String,
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
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {reason}; choose fewer in `trainer.threads`")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// The system's reason.
        reason: String,
    },
}
