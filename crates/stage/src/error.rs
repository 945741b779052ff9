//! Why a world cannot be built.

/// A world could not be built.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// MuJoCo refused the model.
    #[error("MuJoCo refuses the model: {0}; if task.physics values were changed, set them back")]
    Model(String),
    /// The model has no object of this name. This is a bug in `mjcf.rs`.
    #[error("the model has no {0}")]
    Missing(String),
}
