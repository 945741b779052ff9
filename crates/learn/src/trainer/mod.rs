//! A training: acting and learning, with logs, evaluations and checkpoints at intervals.
//!
//! Reading order: [`Trainer::run`] here is the loop, `Trainer::vector_step` one pass of it. The
//! parts of a trainer are the [`Collector`] (environments and actions), the learner ([`Droq`]) with
//! its replay buffer, the [`Evaluation`], the [`Logger`] and the [`Checkpoints`]. `start` has the
//! ways to begin.

mod checkpoint;
mod collector;
mod error;
mod evaluation;
mod logger;
mod metrics;
mod observer;
mod start;
mod sums;
mod warm_start;

#[cfg(test)]
mod tests;

use std::sync::Arc;

pub use checkpoint::Best;
pub use error::TrainError;
pub use observer::{EvaluationRow, LogRow, StopReason, TrainingObserver};
pub use warm_start::WarmStart;

use crate::{
    config::{DroqConfig, TrainerConfig},
    droq::{Droq, Losses},
    env::{Evaluator, Score, VectorEnvironment},
    files::RawTensor,
    policy::Policy,
    replay::Replay,
};
use checkpoint::{Checkpoints, Extras, Header, Origin, SCHEMA};
use collector::Collector;
use evaluation::Evaluation;
use logger::Logger;
pub(crate) use start::thread_pool;

/// Updates in which new critics learn alone before the actor of a policy file is updated.
const CRITICS_ALONE_UPDATES: u64 = 2_500;

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
    /// Wall-clock seconds over all resumptions. What was trained after the last kept log row before
    /// a resumption does not count.
    pub elapsed_secs: f64,
}

/// What a training needs besides its two configurations.
pub struct TrainingInputs {
    /// The environments.
    pub environment: Box<dyn VectorEnvironment>,
    /// The evaluator.
    pub evaluator: Box<dyn Evaluator>,
    /// Written into the policy files as `notes.training`, for example song and resolved
    /// configuration.
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
    notes: serde_json::Value,
    origin: Origin,
    /// Environment steps made.
    step: u64,
    collector: Collector,
    droq: Droq,
    replay: Replay,
    evaluation: Evaluation,
    logger: Logger,
    checkpoints: Checkpoints,
    pool: Arc<rayon::ThreadPool>,
}

impl Trainer {
    /// Environment steps made so far.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// The best evaluation so far.
    pub fn best(&self) -> Option<&Best> {
        self.evaluation.best.as_ref()
    }

    /// The current policy.
    pub fn policy(&self) -> Policy {
        policy(&self.droq, &self.notes, self.step, &[])
    }

    /// Trains to the end, or until the observer stops it. In both cases a checkpoint is saved.
    ///
    /// At the end of all steps there is also an evaluation. After a stop there is none, so that a
    /// training that is stopped and resumed is the same as one that was never stopped.
    ///
    /// # Errors
    /// If a number is not finite or a file cannot be written.
    pub fn run(&mut self, observer: &mut dyn TrainingObserver) -> Result<Outcome, TrainError> {
        let pool = self.pool.clone();
        pool.install(|| self.run_in_pool(observer))
    }

    fn run_in_pool(&mut self, observer: &mut dyn TrainingObserver) -> Result<Outcome, TrainError> {
        let mut stopped = None;
        let mut saved = None;
        let evaluates = self.config.evaluate_every_steps > 0;
        let is_new = self.step == 0 && self.evaluation.last_step.is_none();
        if self.origin != Origin::Fresh && is_new && evaluates {
            self.evaluate(observer)?;
        }
        while self.step < self.config.total_steps {
            stopped = observer.should_stop();
            if stopped.is_some() {
                break;
            }
            let before = self.step;
            self.vector_step()?;
            let after = self.step;
            let reached = |every: u64| every > 0 && before / every != after / every;
            if reached(self.config.log_every_steps) {
                observer.on_log(&self.logger.write_log(self.step, &self.droq, &self.replay)?);
            }
            if reached(self.config.evaluate_every_steps) {
                self.evaluate(observer)?;
            }
            if reached(self.config.checkpoint_every_steps) {
                self.save()?;
                saved = Some(self.step);
            }
        }
        let is_evaluated = self.evaluation.last_step == Some(self.step);
        if stopped.is_none() && evaluates && !is_evaluated && self.step > 0 {
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
            best: self.best().cloned(),
            elapsed_secs: self.logger.elapsed_secs(),
        })
    }

    /// One step of all environments, and the updates beside it.
    ///
    /// The updates draw from the replay buffer as it was before the step, so stepping and updating
    /// are independent and may run at the same time. Whether they do changes only the speed.
    fn vector_step(&mut self) -> Result<(), TrainError> {
        let Self { config, collector, droq, replay, logger, step, .. } = self;
        let warms_up = *step < config.warmup_steps;
        if warms_up && self.origin == Origin::Fresh {
            collector.draw_random_actions();
        } else {
            collector.draw_actions(droq.actor_parameters());
        }
        let updates = if warms_up { 0 } else { config.updates_per_vector_step };
        droq.hold_actor(self.origin == Origin::Policy && droq.updates() < CRITICS_ALONE_UPDATES);
        let (buffer, sums) = (&*replay, &mut logger.sums);
        let mut learn = || -> Result<(), Losses> {
            for _ in 0..updates {
                let losses = droq.learn(buffer, true);
                if !(losses.critic + losses.actor + losses.temperature).is_finite() {
                    return Err(losses);
                }
                sums.add_update(&losses);
            }
            Ok(())
        };
        let learned = if updates == 0 || !config.overlap {
            collector.step();
            learn()
        } else {
            rayon::join(learn, || collector.step()).0
        };
        if let Err(losses) = learned {
            return Err(TrainError::NotFinite { what: format!("a loss ({losses:?})"), step: *step });
        }
        logger.sums.add_step(collector.batch(*step)?);
        collector.store(replay);
        *step += config.num_envs as u64;
        Ok(())
    }

    fn evaluate(&mut self, observer: &mut dyn TrainingObserver) -> Result<(), TrainError> {
        self.check_finite()?;
        let Self { droq, notes, step, evaluation, logger, .. } = self;
        let row = evaluation.evaluate(*step, |scores| policy(droq, notes, *step, scores), logger)?;
        observer.on_evaluation(&row);
        Ok(())
    }

    fn check_finite(&mut self) -> Result<(), TrainError> {
        match self.droq.not_finite() {
            Some(name) => {
                Err(TrainError::NotFinite { what: format!("a value in tensor `{name}`"), step: self.step })
            }
            None => Ok(()),
        }
    }

    /// Saves a checkpoint and the current policy. If a parameter is not finite, it fails and writes
    /// nothing.
    fn save(&mut self) -> Result<(), TrainError> {
        self.check_finite()?;
        let Collector { environment, observation, policy_stream, warmup_stream, .. } = &self.collector;
        let header = Header {
            schema: SCHEMA.to_owned(),
            step: self.step,
            updates: self.droq.updates(),
            layout: environment.layout(),
            action_len: environment.action_len(),
            reward_terms: self.logger.term_names.clone(),
            droq: self.droq_config.clone(),
            seed: self.config.seed,
            num_envs: self.config.num_envs,
            updates_per_vector_step: self.config.updates_per_vector_step,
            warmup_steps: self.config.warmup_steps,
            best: self.evaluation.best.clone(),
            last_evaluation: self.evaluation.last_step,
            metrics: self.logger.metrics.mark()?,
            segments: Vec::new(),
            update_streams: self.droq.streams(),
            policy_stream: policy_stream.clone(),
            warmup_stream: warmup_stream.clone(),
            origin: self.origin,
        };
        let extras = Extras {
            observation: observation.clone(),
            sums: self.logger.sums.to_values(),
            environment: environment.save_state(),
        };
        let tensors: Vec<RawTensor> = self.droq.tensors().into_iter().map(Into::into).collect();
        let policy = self.policy();
        self.checkpoints.save(header, tensors, &extras, &self.replay, &policy)?;
        Ok(())
    }
}

/// The policy of a learner, with scores in its notes.
fn policy(droq: &Droq, notes: &serde_json::Value, step: u64, scores: &[Score]) -> Policy {
    let scores: serde_json::Map<_, _> =
        scores.iter().map(|score| (score.name.clone(), score.value.into())).collect();
    let notes = serde_json::json!({
        "training": notes, "step": step, "updates": droq.updates(), "scores": scores,
    });
    Policy::new(droq.actor_network(), droq.policy_parameters(), notes)
}
