//! Why a training stops with an error, and what to do then.

use std::path::PathBuf;

use crate::{config::ConfigError, env::EnvironmentError, files::FileError};

/// Why a training could not start or go on. The last checkpoint, if there is one, is intact in every case.
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
    /// A warm start has networks of another form.
    #[error(
        "a training cannot begin with what {} has learned: that has {theirs}, this one {ours}; configure this one alike, or \
         begin without it", origin.display()
    )]
    OtherForm {
        /// The policy or the run.
        origin: PathBuf,
        /// What it has.
        theirs: String,
        /// What the training has.
        ours: String,
    },
    /// Arithmetic or the environment went wrong.
    #[error(
        "{what} is not a finite number at environment step {step}: begin another training with lower learning rates, or look for what the environment does there; \
         the last checkpoint is from before, and resuming it comes to the same"
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
