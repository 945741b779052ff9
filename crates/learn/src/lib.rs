//! DroQ: networks and their kernels, replay buffer, trainer, checkpoints.
//!
//! The environment is a trait ([`mod@env`]), and nothing is printed. A training is a [`Trainer`]:
//! it owns the learner, the replay buffer, a [`VectorEnvironment`] and an [`Evaluator`], writes a
//! run folder (see [`Trainer`]), and reports to a [`TrainingObserver`]. The result is a [`Policy`].
//!
//! Guarantees, each with a test: the same seed gives the same bytes with any number of threads; a
//! training that is stopped or killed and then resumed gives the same bytes as one without
//! interruption; a failed write or a number that is not finite stops a training with its last
//! checkpoint intact; loading a damaged file never panics; every update agrees with PyTorch
//! (`scripts/golden_learn.py`).
//!
//! `examples/toy_training.rs` is a whole training in a hundred lines.

mod actor_inference;
pub mod bench;
mod buffer;
mod config;
mod droq;
pub mod env;
mod files;
mod kernels;
mod network;
mod policy;
mod random;
mod replay;
pub mod seed;
mod tensorboard;
mod tensors;
mod trainer;

pub use config::{Arithmetic, ConfigError, DroqConfig, TrainerConfig};
pub use env::{EnvironmentError, Evaluator, ObservationLayout, Score, StepBatch, VectorEnvironment};
pub use files::FileError;
pub use kernels::bf16_available;
pub use policy::{Policy, PolicyHeader, PolicyLayer};
pub use trainer::{
    Best, EvaluationRow, LogRow, Outcome, StopReason, TrainError, Trainer, TrainingInputs, TrainingObserver,
    WarmStart,
};
