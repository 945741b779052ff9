//! Starting and resuming a training.

use std::path::Path;

use super::{
    Trainer, TrainingInputs,
    checkpoint::{Checkpoints, LAST_POLICY, Origin},
    collector::Collector,
    error::TrainError,
    evaluation::{BEST_POLICY, Evaluation},
    logger::Logger,
    metrics::Mark,
    warm_start::WarmStart,
};
use crate::{
    config::{ConfigError, DroqConfig, TrainerConfig},
    droq::Droq,
    env::VectorEnvironment,
    files::{FileError, read},
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

/// An error unless the checkpoint's `saved` is what the caller has `given`.
fn same<T: PartialEq + std::fmt::Debug>(what: &str, saved: &T, given: &T) -> Result<(), TrainError> {
    if saved == given {
        return Ok(());
    }
    Err(TrainError::Refused(format!(
        "this checkpoint was made with {what} = {saved:?}, not {given:?}: resume with the saved value, or start a new training"
    )))
}

impl Trainer {
    /// Starts a training in `folder`, which is created if it does not exist, and saves its first
    /// checkpoint. With a `source` its parameters are those of another training instead of random
    /// ones; see [`WarmStart`]. They are evaluated first, at step 0.
    ///
    /// # Errors
    /// If the configuration cannot work, `folder` already holds a training, the source's networks
    /// have another shape, or a file cannot be written. Nothing is written before all else is
    /// checked.
    pub fn start(
        folder: &Path,
        droq: &DroqConfig,
        config: &TrainerConfig,
        inputs: TrainingInputs,
        source: Option<&WarmStart>,
    ) -> Result<Self, TrainError> {
        Self::check_vacant(folder)?;
        droq.check()?;
        config.check()?;
        let mut learner = Self::learner(droq, config, &*inputs.environment);
        if let Some(source) = source {
            source.check(droq, &*inputs.environment)?;
            source.load(&mut learner)?;
        }
        Checkpoints::new(folder).prepare()?;
        let mut trainer = Self::build(folder, droq, config, inputs, learner, (Mark::default(), [0, 0]))?;
        trainer.origin = source.map_or(Origin::Fresh, WarmStart::origin);
        trainer.collector.reset();
        trainer.logger.metrics.cut_back()?;
        trainer.save()?;
        Ok(trainer)
    }

    /// Continues the training in `folder` from its last checkpoint, bit for bit as if it had never
    /// stopped.
    ///
    /// Total steps, intervals, threads and overlap may differ from before; everything else must be
    /// the same. Rows of metrics after the checkpoint are removed, since they will be written
    /// again.
    ///
    /// # Errors
    /// If the checkpoint is missing or damaged, or belongs to a training with another
    /// configuration. Nothing in the folder changes then.
    pub fn resume(
        folder: &Path,
        droq: &DroqConfig,
        config: &TrainerConfig,
        inputs: TrainingInputs,
    ) -> Result<Self, TrainError> {
        let checkpoints = Checkpoints::new(folder);
        if !checkpoints.exists() {
            return Err(TrainError::NothingToResume { folder: folder.to_owned() });
        }
        droq.check()?;
        config.check()?;
        let path = checkpoints.path();
        let bytes = read(&path)?;
        let (header, file, extras) = checkpoints.load(&bytes)?;
        let environment = &*inputs.environment;
        same("droq", &header.droq, droq)?;
        same("trainer.seed", &header.seed, &config.seed)?;
        same("trainer.num_envs", &header.num_envs, &config.num_envs)?;
        let updates = (&header.updates_per_vector_step, &config.updates_per_vector_step);
        same("trainer.updates_per_vector_step", updates.0, updates.1)?;
        same("trainer.warmup_steps", &header.warmup_steps, &config.warmup_steps)?;
        same("the observation layout", &header.layout, &environment.layout())?;
        same("the action length", &header.action_len, &environment.action_len())?;
        same("the reward terms", &header.reward_terms, &environment.reward_term_names())?;
        let bad = |reason: &str| TrainError::from(FileError::content(&path, reason));
        let learner = Self::learner(droq, config, environment);
        let at = (header.metrics, [header.step, header.updates]);
        let mut trainer = Self::build(folder, droq, config, inputs, learner, at)?;
        trainer.droq.load_tensors(&|name| file.floats(name)).map_err(|reason| bad(&reason))?;
        if !trainer.droq.restore_counters(header.updates, header.update_streams) {
            return Err(bad("its draws are those of another batch"));
        }
        checkpoints.load_replay(&header.segments, &mut trainer.replay)?;
        if trainer.replay.total() != header.step {
            return Err(bad("its replay segments do not reach its step"));
        }
        let Trainer { collector, logger, evaluation, .. } = &mut trainer;
        if extras.observation.len() != collector.observation.len()
            || !extras.observation.iter().all(|value| value.is_finite())
        {
            return Err(bad("its observation has the wrong length or is not finite"));
        }
        collector.observation = extras.observation;
        if !logger.sums.set_values(&extras.sums) {
            return Err(bad("its sums have the wrong length"));
        }
        collector.environment.load_state(&extras.environment)?;
        (collector.policy_stream, collector.warmup_stream) = (header.policy_stream, header.warmup_stream);
        (evaluation.best, evaluation.last_step) = (header.best, header.last_evaluation);
        (trainer.step, trainer.origin) = (header.step, header.origin);
        trainer.checkpoints.segments = header.segments;
        trainer.logger.metrics.cut_back()?;
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
        // These files are written after the first checkpoint: a training killed before that may
        // start again.
        if [LAST_POLICY, BEST_POLICY].iter().any(|policy| folder.join(policy).exists()) {
            return refuse(
                "without its checkpoint, which can be played but not continued: choose another folder, or delete it",
            );
        }
        Ok(())
    }

    /// Whether `folder` holds a training that [`resume`](Self::resume) can continue.
    pub fn exists(folder: &Path) -> bool {
        Checkpoints::new(folder).exists()
    }

    /// Checks that the training in `folder` is of this version of Étude.
    ///
    /// # Errors
    /// If its checkpoint is of another one, or damaged.
    pub fn check_schema(folder: &Path) -> Result<(), TrainError> {
        let store = Checkpoints::new(folder);
        store.parse(&read(&store.path())?)?;
        Ok(())
    }

    /// A learner with random networks for this environment.
    pub(super) fn learner(
        droq: &DroqConfig,
        config: &TrainerConfig,
        environment: &dyn VectorEnvironment,
    ) -> Droq {
        Droq::new(droq, environment.layout(), environment.action_len(), config.seed)
    }

    /// A training whose logs continue at a mark, environment step and number of updates.
    fn build(
        folder: &Path,
        droq_config: &DroqConfig,
        config: &TrainerConfig,
        inputs: TrainingInputs,
        droq: Droq,
        (mark, at): (Mark, [u64; 2]),
    ) -> Result<Self, TrainError> {
        let TrainingInputs { environment, evaluator, notes } = inputs;
        let (n, layout, action_len) =
            (environment.num_envs(), environment.layout(), environment.action_len());
        if n != config.num_envs {
            let why =
                format!("trainer.num_envs is {}: the given environment has {n} copies", config.num_envs);
            return Err(ConfigError(why).into());
        }
        let capacity = droq_config.replay_capacity;
        if !Replay::fits(layout, action_len, capacity) {
            let why = "the memory of this machine does not hold as many transitions";
            return Err(ConfigError(format!("droq.replay_capacity is {capacity}: {why}")).into());
        }
        let pool = std::sync::Arc::new(thread_pool(config.threads)?);
        Ok(Self {
            logger: Logger::open(folder, mark, n, environment.reward_term_names(), at)?,
            evaluation: Evaluation::new(evaluator, &config.best_by, folder),
            collector: Collector::new(environment, &droq, droq_config, config),
            checkpoints: Checkpoints::new(folder),
            replay: Replay::new(layout, action_len, capacity, n),
            config: config.clone(),
            droq_config: droq_config.clone(),
            notes,
            origin: Origin::Fresh,
            step: 0,
            droq,
            pool,
        })
    }
}
