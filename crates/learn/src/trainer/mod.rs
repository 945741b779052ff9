//! A training: rounds of acting and learning, with logs, evaluations and checkpoints at intervals.
//!
//! Reading order: [`Trainer::run`] here is the loop; `round` is one round; `start`, `resume` and `warm` are the three ways to begin;
//! `report` has logs and evaluations, `checkpoint` the files.

mod checkpoint;
mod error;
mod metrics;
mod observer;
mod report;
mod resume;
mod round;
mod start;
mod sums;
mod warm;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod toy;
#[cfg(test)]
mod warm_tests;

use std::{path::PathBuf, time::Instant};

pub use checkpoint::Best;
pub use error::TrainError;
pub use observer::{EvaluationRow, LogRow, StopReason, TrainingObserver};
pub use warm::WarmStart;

use crate::{
    acting::Acting,
    config::{DroqConfig, TrainerConfig},
    droq::Droq,
    env::{Evaluator, Score, StepBatch, VectorEnvironment},
    files::RawTensor,
    policy::Policy,
    random::Stream,
    replay::{Replay, Segment},
};
use checkpoint::{Beginning, Extras, Header, SCHEMA, Store};
use metrics::Metrics;
pub(crate) use start::thread_pool;
use sums::Sums;

const BEST_POLICY: &str = "policy-best.safetensors";
const LAST_POLICY: &str = "policy-last.safetensors";

/// How a training ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Why it stopped early; `None` when all steps were made.
    pub stopped: Option<StopReason>,
    /// Environment steps made, over all resumptions.
    pub step: u64,
    /// Updates made.
    pub updates: u64,
    /// The best evaluation.
    pub best: Option<Best>,
    /// Wall-clock seconds over all resumptions. What was trained after the last kept log row before a resumption does not count.
    pub elapsed_secs: f64,
}

/// What a training needs besides its two configurations.
pub struct Parts {
    /// The environments.
    pub environment: Box<dyn VectorEnvironment>,
    /// The evaluator.
    pub evaluator: Box<dyn Evaluator>,
    /// Written into the policy files as `notes.training`, for example song and resolved configuration.
    pub notes: serde_json::Value,
}

/// One training in one folder:
///
/// ```text
/// metrics.jsonl                     one flat JSON object per log interval or evaluation
/// events.out.tfevents.etude         the same for TensorBoard
/// policy-best.safetensors           the policy with the best score so far
/// policy-best-STEP.safetensors      a better one, from an evaluation after the checkpoint that was resumed
/// policy-last.safetensors           the policy of the last checkpoint
/// checkpoints/last.safetensors      the state, from which resuming continues bit for bit
/// checkpoints/replay/A-B.replay     transitions A to B (exclusive), never changed once written
/// ```
pub struct Trainer {
    config: TrainerConfig,
    droq_config: DroqConfig,
    folder: PathBuf,
    store: Store,
    parts: Parts,
    term_names: Vec<String>,
    droq: Droq,
    replay: Replay,
    segments: Vec<Segment>,
    acting: Acting,
    policy_stream: Stream,
    warmup_stream: Stream,
    beginning: Beginning,
    /// Environment steps made.
    step: u64,
    best: Option<Best>,
    last_evaluation: Option<u64>,
    sums: Sums,
    metrics: Metrics,
    pool: std::sync::Arc<rayon::ThreadPool>,
    buffers: Buffers,
    clock: Clock,
}

/// Buffers of a round.
struct Buffers {
    /// `[n, observation]`: the current observations.
    observation: Vec<f32>,
    /// `[n, action]` each.
    action: Vec<f32>,
    noise: Vec<f32>,
    batch: StepBatch,
}

/// Wall-clock time; used for metrics only.
struct Clock {
    started: Instant,
    /// Seconds of the training before `started`.
    before: f64,
    last_row: Instant,
    last_step: u64,
    last_updates: u64,
}

impl Trainer {
    /// Environment steps made so far.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// The best evaluation so far.
    pub fn best(&self) -> Option<&Best> {
        self.best.as_ref()
    }

    /// The current policy.
    pub fn policy(&self) -> Policy {
        self.policy_with(&[])
    }

    fn policy_with(&self, scores: &[Score]) -> Policy {
        let scores: serde_json::Map<_, _> =
            scores.iter().map(|score| (score.name.clone(), score.value.into())).collect();
        let notes = serde_json::json!({
            "training": self.parts.notes, "step": self.step, "updates": self.droq.updates(), "scores": scores,
        });
        Policy::new(self.droq.actor_network(), self.droq.policy_parameters(), notes)
    }

    /// Trains to the end, or until the observer stops it. In both cases a checkpoint is saved.
    ///
    /// At the end of all steps there is also an evaluation. After a stop there is none, so that a training that is stopped and
    /// resumed is the same as one that was never stopped.
    ///
    /// # Errors
    /// If a number is not finite or a file cannot be written.
    pub fn run(&mut self, observer: &mut dyn TrainingObserver) -> Result<Outcome, TrainError> {
        let pool = self.pool.clone();
        pool.install(|| self.rounds(observer))
    }

    fn rounds(&mut self, observer: &mut dyn TrainingObserver) -> Result<Outcome, TrainError> {
        let mut stopped = None;
        let mut saved = None;
        let untried = self.step == 0 && self.last_evaluation.is_none();
        if self.beginning != Beginning::Fresh && untried && self.config.evaluate_every_steps > 0 {
            self.evaluate(observer)?;
        }
        while self.step < self.config.total_steps {
            stopped = observer.should_stop();
            if stopped.is_some() {
                break;
            }
            let before = self.step;
            self.round()?;
            let after = self.step;
            let reached = |every: u64| every > 0 && before / every != after / every;
            if reached(self.config.log_every_steps) {
                self.log(observer)?;
            }
            if reached(self.config.evaluate_every_steps) {
                self.evaluate(observer)?;
            }
            if reached(self.config.checkpoint_every_steps) {
                self.save()?;
                saved = Some(self.step);
            }
        }
        let unseen = self.config.evaluate_every_steps > 0 && self.last_evaluation != Some(self.step);
        if stopped.is_none() && unseen && self.step > 0 {
            self.evaluate(observer)?;
            saved = None;
        }
        if saved != Some(self.step) {
            self.save()?;
        }
        Ok(Outcome {
            stopped,
            step: self.step,
            updates: self.droq.updates(),
            best: self.best.clone(),
            elapsed_secs: self.elapsed_secs(),
        })
    }

    fn elapsed_secs(&self) -> f64 {
        self.clock.before + self.clock.started.elapsed().as_secs_f64()
    }

    fn check_finite(&self) -> Result<(), TrainError> {
        match self.droq.not_finite() {
            Some(name) => {
                Err(TrainError::NotFinite { what: format!("a value in tensor `{name}`"), step: self.step })
            }
            None => Ok(()),
        }
    }

    /// Saves a checkpoint and the current policy. If a parameter is not finite, it fails and writes nothing.
    fn save(&mut self) -> Result<(), TrainError> {
        self.check_finite()?;
        let metrics = self.metrics.mark()?;
        let mut segments = self.segments.clone();
        self.store.save_replay(&self.replay, &mut segments)?;
        let environment = &self.parts.environment;
        let header = Header {
            schema: SCHEMA.to_owned(),
            step: self.step,
            updates: self.droq.updates(),
            layout: environment.layout(),
            action_len: environment.action_len(),
            reward_terms: self.term_names.clone(),
            droq: self.droq_config.clone(),
            seed: self.config.seed,
            num_envs: self.config.num_envs,
            updates_per_round: self.config.updates_per_round,
            warmup_steps: self.config.warmup_steps,
            best: self.best.clone(),
            last_evaluation: self.last_evaluation,
            metrics,
            segments,
            update_streams: self.droq.streams(),
            policy_stream: self.policy_stream.clone(),
            warmup_stream: self.warmup_stream.clone(),
            beginning: self.beginning,
        };
        let extras = Extras {
            observation: self.buffers.observation.clone(),
            sums: self.sums.to_values(),
            environment: environment.save_state(),
        };
        let tensors: Vec<RawTensor> = self.droq.tensors().into_iter().map(Into::into).collect();
        self.store.save(&header, tensors, &extras)?;
        self.segments = header.segments;
        self.policy().save(&self.folder.join(LAST_POLICY))?;
        Ok(())
    }
}
