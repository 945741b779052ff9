//! How a training tells the world about itself, and how the world stops it. The library itself never prints.

use crate::env::Score;

/// Metrics of one log interval, as written to `metrics.jsonl`.
#[derive(Clone, Debug, PartialEq)]
pub struct LogRow {
    /// Environment steps so far.
    pub step: u64,
    /// Named values, for example `losses/critic`, in the order in which they are written.
    pub values: Vec<(String, f64)>,
}

impl LogRow {
    /// The value called `name`.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.values.iter().find(|(key, _)| key == name).map(|(_, value)| *value)
    }
}

/// Result of one evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationRow {
    /// Environment steps so far.
    pub step: u64,
    /// The evaluator's scores.
    pub scores: Vec<Score>,
    /// Whether the first score is the best of this training so far.
    pub best: bool,
}

/// Why a training was asked to stop early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// Someone asked: Ctrl-C, a signal, a button.
    Requested,
    /// The time that was given is up.
    OutOfTime,
}

/// Watches a training. Every method has an empty default; none may block for long, since the training waits.
pub trait TrainingObserver: Send {
    /// A log interval is over.
    fn on_log(&mut self, _row: &LogRow) {}
    /// An evaluation is over.
    fn on_evaluation(&mut self, _row: &EvaluationRow) {}
    /// A checkpoint of this environment step is safely on disk.
    fn on_checkpoint(&mut self, _step: u64) {}
    /// Asked once a round. With a reason, the training saves a checkpoint and returns.
    fn should_stop(&mut self) -> Option<StopReason> {
        None
    }
}

/// Watches nothing and never stops.
impl TrainingObserver for () {}
