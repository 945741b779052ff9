//! DroQ for a hand that learns to play the piano: networks and their kernels, replay, trainer, checkpoints.
//!
//! The crate knows an environment only as a trait ([`mod@env`]), and never prints. A training is a [`Trainer`]: it owns the
//! learner, the replay, a [`VectorEnvironment`] and an [`Evaluator`], writes a run folder (its layout is at [`Trainer`]),
//! and reports to a [`TrainingObserver`]. What comes out is a [`Policy`].
//!
//! Promises, each with a test: same seed, same bytes, whatever the number of threads; a training that is stopped, or
//! killed, and resumed is the training that never was; a full disk or a number that is not finite stops a training with
//! its last checkpoint intact; no file, however damaged, makes loading panic; and every update agrees with PyTorch
//! (`scripts/golden_learn.py`).
//!
//! `examples/toy_training.rs` is a whole training in a hundred lines.

mod acting;
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
    Best, EvaluationRow, LogRow, Outcome, Parts, StopReason, TrainError, Trainer, TrainingObserver, WarmStart,
};
