//! Starting a training, and building its parts.

use std::{fmt::Display, path::Path, time::Instant};

use super::{
    BEST_POLICY, Buffers, Clock, LAST_POLICY, Parts, TrainError, Trainer, WarmStart,
    checkpoint::{Beginning, Store},
    metrics::{self, Metrics},
    sums::Sums,
};
use crate::{
    acting::Acting,
    config::{ConfigError, DroqConfig, TrainerConfig},
    droq::Droq,
    env::StepBatch,
    random::Stream,
    replay::Replay,
};

/// The threads of a training; 0 for one a processor core.
pub(crate) fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, TrainError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("etude-{index}"))
        .build()
        .map_err(|error| {
            TrainError::Refused(format!(
                "cannot start {threads} threads: {error}; choose fewer in `trainer.threads`"
            ))
        })
}

impl Trainer {
    /// Starts a training in `folder`, which is created if it does not exist, and saves its first checkpoint. With a `source` its
    /// parameters are those of another training instead of random ones; see [`WarmStart`]. They are evaluated first, at step 0.
    ///
    /// # Errors
    /// If the configuration cannot work, `folder` already holds a training, the source's networks have another shape, or a file
    /// cannot be written. Nothing is written before all else is checked.
    pub fn start(
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
            learner.adopt(&source.knowledge);
        }
        Store::new(folder).prepare()?;
        let mut trainer = Self::build(folder, droq, config, parts, learner, metrics::Mark::default())?;
        trainer.beginning = source.map_or(Beginning::Fresh, WarmStart::beginning);
        trainer.parts.environment.reset(&mut trainer.buffers.observation);
        trainer.metrics.cut_back()?;
        trainer.save()?;
        Ok(trainer)
    }

    /// Checks that a training may begin in `folder`.
    ///
    /// # Errors
    /// If it holds a training, or the results of one whose checkpoint is missing.
    pub fn check_vacant(folder: &Path) -> Result<(), TrainError> {
        let refuse =
            |why: &str| Err(TrainError::Refused(format!("{} holds a training {why}", folder.display())));
        if Self::exists(folder) {
            return refuse("already: resume it, or choose another folder");
        }
        // These files are written after the first checkpoint: a training killed before that may start again.
        if [LAST_POLICY, BEST_POLICY].iter().any(|policy| folder.join(policy).exists()) {
            return refuse(
                "without its checkpoint, which can be played but not continued: choose another folder, or delete it",
            );
        }
        Ok(())
    }

    /// Whether `folder` holds a training that [`resume`](Self::resume) can continue.
    pub fn exists(folder: &Path) -> bool {
        Store::new(folder).exists()
    }

    /// A learner with random networks for these parts.
    pub(super) fn learner(droq: &DroqConfig, config: &TrainerConfig, parts: &Parts) -> Droq {
        Droq::new(droq, parts.environment.layout(), parts.environment.action_len(), config.seed)
    }

    pub(super) fn build(
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
        let refuse = |field, value: &dyn Display, rule| {
            Err(ConfigError { field, value: value.to_string(), rule }.into())
        };
        if n != config.num_envs {
            let rule = "the environment that was given has another number of copies";
            return refuse("trainer.num_envs", &config.num_envs, rule);
        }
        if !Replay::fits(layout, action_len, droq_config.replay_capacity) {
            let rule = "the memory of this machine does not hold as many transitions";
            return refuse("droq.replay_capacity", &droq_config.replay_capacity, rule);
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
                batch: StepBatch::new(n, layout, term_names.len()),
            },
            clock: Clock { started: now, before, last_row: now, last_step: 0, last_updates: 0 },
            term_names,
            parts,
        })
    }
}
