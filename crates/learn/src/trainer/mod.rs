//! A training: rounds of acting and learning, looked at and saved at intervals.

mod checkpoint;
mod demonstrations;
mod error;
mod metrics;
mod observer;
mod report;
mod resume;
mod round;
mod sums;
mod warm;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod toy;
#[cfg(test)]
mod warm_tests;

use std::{
    path::{Path, PathBuf},
    time::Instant,
};

pub use checkpoint::Best;
pub use error::TrainError;
pub use observer::{EvaluationRow, LogRow, StopReason, TrainingObserver};
pub use warm::WarmStart;

use crate::{
    acting::Acting,
    config::{ConfigError, DroqConfig, TrainerConfig},
    droq::Droq,
    env::{Evaluator, Score, StepBatch, VectorEnvironment},
    files::RawTensor,
    policy::Policy,
    random::Stream,
    replay::{Replay, Segment},
};
use checkpoint::{Extras, Header, Store};
use demonstrations::Demonstrations;
use metrics::Metrics;
use sums::Sums;
use warm::Beginning;

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
    /// Wall-clock seconds, over all resumptions; before each of them they count up to the last log row that was kept.
    pub elapsed_secs: f64,
}

/// What a training is made of, besides its two configurations.
pub struct Parts {
    /// Where experience comes from.
    pub environment: Box<dyn VectorEnvironment>,
    /// What chooses the best policy.
    pub evaluator: Box<dyn Evaluator>,
    /// Written into the policy files as `notes.training`, for example song and resolved configuration.
    pub notes: serde_json::Value,
}

/// One training in one folder:
///
/// ```text
/// metrics.jsonl                     one flat JSON object per log interval or evaluation
/// events.out.tfevents.etude         the same for TensorBoard
/// policy-best.safetensors           the policy with the best first score so far
/// policy-best-STEP.safetensors      a better one, of a step that a kill undid and that did not come again
/// policy-last.safetensors           the policy of the last checkpoint
/// checkpoints/last.safetensors      everything needed to continue bit for bit, replaced in one rename
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
    demonstrations: Demonstrations,
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

/// What a round writes into.
struct Buffers {
    /// `[n, observation]`: what to act on.
    observation: Vec<f32>,
    /// `[n, action]` each.
    action: Vec<f32>,
    noise: Vec<f32>,
    demonstrated: Vec<f32>,
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

/// The threads of a training; 0 for one a processor core.
pub(crate) fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, TrainError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("etude-{index}"))
        .build()
        .map_err(|error| TrainError::Threads { threads, reason: error.to_string() })
}

impl Trainer {
    /// Starts a training in `folder` (created when missing) and saves its first checkpoint.
    pub fn start(
        folder: &Path,
        droq: &DroqConfig,
        config: &TrainerConfig,
        parts: Parts,
    ) -> Result<Self, TrainError> {
        Self::begin(folder, droq, config, parts, None)
    }

    /// The same with what another training has learned instead of random networks; see [`WarmStart`]. Its first evaluation is
    /// of what was taken over, at step 0. Nothing is written if that does not fit.
    pub fn start_from(
        folder: &Path,
        droq: &DroqConfig,
        config: &TrainerConfig,
        parts: Parts,
        source: &WarmStart,
    ) -> Result<Self, TrainError> {
        Self::begin(folder, droq, config, parts, Some(source))
    }

    fn begin(
        folder: &Path,
        droq: &DroqConfig,
        config: &TrainerConfig,
        parts: Parts,
        source: Option<&WarmStart>,
    ) -> Result<Self, TrainError> {
        Self::check_vacant(folder)?;
        droq.validate()?;
        config.validate()?;
        let mut learner = Self::learner(droq, config, &parts);
        if let Some(source) = source {
            source.check(droq, &*parts.environment)?;
            learner.adopt(source.knowledge());
        }
        Store::new(folder).prepare()?;
        let mut trainer = Self::build(folder, droq, config, parts, learner, metrics::Mark::default())?;
        trainer.beginning = source.map_or(Beginning::Fresh, WarmStart::beginning);
        trainer.parts.environment.reset(&mut trainer.buffers.observation);
        trainer.metrics.cut_back()?;
        trainer.save()?;
        Ok(trainer)
    }

    /// An error if `folder` holds a training, or the results of one whose checkpoint is gone: none may begin there.
    pub fn check_vacant(folder: &Path) -> Result<(), TrainError> {
        let folder = folder.to_owned();
        if Self::exists(&folder) {
            return Err(TrainError::AlreadyStarted { folder });
        }
        // Written after a first checkpoint only: what was killed before it may begin once more.
        if folder.join(LAST_POLICY).exists() {
            return Err(TrainError::CheckpointGone { folder });
        }
        Ok(())
    }

    /// Whether `folder` holds a training that [`resume`](Self::resume) can continue.
    pub fn exists(folder: &Path) -> bool {
        Store::new(folder).exists()
    }

    /// A learner with random networks for these parts.
    fn learner(droq: &DroqConfig, config: &TrainerConfig, parts: &Parts) -> Droq {
        Droq::new(droq, parts.environment.layout(), parts.environment.action_len(), config.seed)
    }

    fn build(
        folder: &Path,
        droq_config: &DroqConfig,
        config: &TrainerConfig,
        parts: Parts,
        droq: Droq,
        mark: metrics::Mark,
    ) -> Result<Self, TrainError> {
        let environment = &parts.environment;
        let (n, layout, action_len) =
            (environment.num_envs(), environment.layout(), environment.action_len());
        if n != config.num_envs {
            let value = config.num_envs.to_string();
            let rule = "the environment that was given has another number of copies";
            return Err(ConfigError { field: "trainer.num_envs", value, rule }.into());
        }
        let mut demonstrated = vec![0.0; n * action_len];
        if config.demonstration_share > 0.0 && !environment.demonstrate(&mut demonstrated) {
            let value = config.demonstration_share.to_string();
            let rule = "this environment has no demonstrator";
            return Err(ConfigError { field: "trainer.demonstration_share", value, rule }.into());
        }
        if !Replay::fits(layout, action_len, droq_config.replay_capacity) {
            let value = droq_config.replay_capacity.to_string();
            let rule = "the memory of this machine does not hold as many transitions";
            return Err(ConfigError { field: "droq.replay_capacity", value, rule }.into());
        }
        let term_names = environment.reward_term_names();
        let pool = thread_pool(config.threads)?;
        let (metrics, before) = Metrics::open(folder, mark)?;
        let now = Instant::now();
        Ok(Self {
            config: config.clone(),
            droq_config: droq_config.clone(),
            folder: folder.to_owned(),
            store: Store::new(folder),
            acting: Acting::new(droq.actor_network(), n),
            droq,
            replay: Replay::new(layout, action_len, droq_config.replay_capacity, n),
            segments: Vec::new(),
            policy_stream: Stream::new(config.seed, "trainer/policy"),
            warmup_stream: Stream::new(config.seed, "trainer/warmup"),
            demonstrations: Demonstrations::new(config),
            beginning: Beginning::Fresh,
            step: 0,
            best: None,
            last_evaluation: None,
            sums: Sums::new(n, term_names.len()),
            metrics,
            pool: std::sync::Arc::new(pool),
            buffers: Buffers {
                observation: vec![0.0; n * layout.len()],
                action: vec![0.0; n * action_len],
                noise: vec![0.0; n * action_len],
                demonstrated,
                batch: StepBatch::new(n, layout, term_names.len()),
            },
            clock: Clock { started: now, before, last_row: now, last_step: 0, last_updates: 0 },
            term_names,
            parts,
        })
    }

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

    /// Trains to the end, or until the observer stops it. In both cases a checkpoint is saved before this returns.
    ///
    /// The end of all steps also brings an evaluation; a stop does not, so that a training that is stopped and resumed
    /// is the same as one that never was.
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
                observer.on_checkpoint(self.step);
            }
        }
        let unseen = self.config.evaluate_every_steps > 0 && self.last_evaluation != Some(self.step);
        if stopped.is_none() && unseen && self.step > 0 {
            self.evaluate(observer)?;
            saved = None;
        }
        if saved != Some(self.step) {
            self.save()?;
            observer.on_checkpoint(self.step);
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

    /// Saves a checkpoint and the current policy. Nothing is touched when a parameter is not finite.
    fn save(&mut self) -> Result<(), TrainError> {
        self.check_finite()?;
        let metrics = self.metrics.mark()?;
        let mut segments = self.segments.clone();
        self.store.save_replay(&self.replay, &mut segments)?;
        let environment = &self.parts.environment;
        let header = Header {
            schema: Header::schema(),
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
            demonstration_share: self.config.demonstration_share,
            demonstration_noise: self.config.demonstration_noise,
            demonstrations: self.demonstrations.clone(),
            beginning: self.beginning,
        };
        let extras = Extras {
            observation: self.buffers.observation.clone(),
            sums: self.sums.to_values(),
            environment: environment.save_state(),
        };
        let temperature = self.droq.temperature_tensor();
        let tensors: Vec<RawTensor> = self.droq.tensors(&temperature).into_iter().map(Into::into).collect();
        self.store.save(&header, tensors, &extras)?;
        self.segments = header.segments;
        self.policy().save(&self.folder.join(LAST_POLICY))?;
        Ok(())
    }
}
