//! Progress of a training, and how to stop it.

use crate::env::Score;

/// Metrics of one log interval, as written to `metrics.jsonl`.
#[derive(Clone, Debug, PartialEq)]
pub struct LogRow {
    /// Environment steps so far.
    pub step: u64,
    /// Named values, for example `losses/critic`, in the order in which they are written.
    pub values: Vec<(String, f64)>,
}

/// Result of one evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationRow {
    /// Environment steps so far.
    pub step: u64,
    /// The evaluator's scores.
    pub scores: Vec<Score>,
    /// Whether the deciding score is the best of this training so far.
    pub best: bool,
}

/// Why a training was asked to stop early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// Someone asked: Ctrl-C, a signal, a button.
    Requested,
    /// Its time limit is reached.
    OutOfTime,
}

/// Observes a training. Every method has an empty default. The training waits for each call.
pub trait TrainingObserver: Send {
    /// Called after each log interval.
    fn on_log(&mut self, _row: &LogRow) {}
    /// Called after each evaluation.
    fn on_evaluation(&mut self, _row: &EvaluationRow) {}
    /// Called before each vector step. If it returns a reason, the training saves a checkpoint and
    /// returns.
    fn should_stop(&mut self) -> Option<StopReason> {
        None
    }
}

/// Observes nothing and never stops.
impl TrainingObserver for () {}
