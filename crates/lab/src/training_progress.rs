//! The progress of a training, as a job reports it.

use etude_learn::{EvaluationRow, LogRow, Score, StopReason, TrainingObserver};
use etude_perform::{Job, NoteCounts};

/// The progress of a training.
#[derive(Clone, Copy, Debug)]
pub struct TrainingProgress {
    /// Environment steps so far.
    pub step: u64,
    /// Environment steps in all.
    pub total: u64,
    /// Notes of the best policy so far.
    pub best_notes: Option<NoteCounts>,
    /// Its F1 by control step.
    pub best_f1: Option<f64>,
}

impl TrainingProgress {
    pub(crate) fn new(step: u64, total: u64, best: &[Score]) -> Self {
        Self {
            step,
            total,
            best_notes: NoteCounts::of_evaluation(best),
            best_f1: best.first().map(|score| score.value),
        }
    }

    /// The share of the training that is done, 0 to 1.
    pub fn share(&self) -> f64 {
        self.step as f64 / self.total.max(1) as f64
    }
}

/// Reports a training to a job.
pub(crate) struct JobObserver<'a, 'b> {
    pub at: TrainingProgress,
    pub job: &'a mut Job<'b, TrainingProgress>,
}

impl TrainingObserver for JobObserver<'_, '_> {
    fn on_log(&mut self, row: &LogRow) {
        self.at.step = row.step;
        self.job.report(&self.at);
    }

    fn on_evaluation(&mut self, row: &EvaluationRow) {
        self.at = match row.best {
            true => TrainingProgress::new(row.step, self.at.total, &row.scores),
            false => TrainingProgress { step: row.step, ..self.at },
        };
        self.job.report(&self.at);
    }

    fn should_stop(&mut self) -> Option<StopReason> {
        self.job.is_interrupted().then_some(StopReason::Requested)
    }
}
