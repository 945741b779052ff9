//! Continuing a saved training.

use std::path::Path;

use super::{Parts, TrainError, Trainer, checkpoint::Store};
use crate::{
    config::{DroqConfig, TrainerConfig},
    files::{FileError, read},
};

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
    /// Continues the training in `folder` from its last checkpoint, bit for bit as if it had never stopped.
    ///
    /// Total steps, intervals, threads and overlap may differ from before; everything else must be the same. Rows of metrics after the
    /// checkpoint are removed, since they will be written again.
    ///
    /// # Errors
    /// If the checkpoint is missing or damaged, or belongs to a training with another configuration. Nothing in the folder changes
    /// then.
    pub fn resume(
        folder: &Path,
        droq: &DroqConfig,
        config: &TrainerConfig,
        parts: Parts,
    ) -> Result<Self, TrainError> {
        let store = Store::new(folder);
        if !store.exists() {
            return Err(TrainError::NothingToResume { folder: folder.to_owned() });
        }
        droq.validate()?;
        config.validate()?;
        let path = store.path();
        let bytes = read(&path)?;
        let (header, file, extras) = store.load(&bytes)?;
        same("droq", &header.droq, droq)?;
        same("trainer.seed", &header.seed, &config.seed)?;
        same("trainer.num_envs", &header.num_envs, &config.num_envs)?;
        same("trainer.updates_per_round", &header.updates_per_round, &config.updates_per_round)?;
        same("trainer.warmup_steps", &header.warmup_steps, &config.warmup_steps)?;
        same("the observation layout", &header.layout, &parts.environment.layout())?;
        same("the action length", &header.action_len, &parts.environment.action_len())?;
        same("the reward terms", &header.reward_terms, &parts.environment.reward_term_names())?;
        let bad = |reason: String| TrainError::from(FileError::content(&path, reason));
        let learner = Self::learner(droq, config, &parts);
        let mut trainer = Self::build(folder, droq, config, parts, learner, header.metrics)?;
        trainer.droq.load_tensors(&|name| file.floats(name)).map_err(bad)?;
        if !trainer.droq.restore_counters(header.updates, header.update_streams) {
            return Err(bad("its draws are those of another batch".to_owned()));
        }
        store.load_replay(&header.segments, &mut trainer.replay)?;
        if trainer.replay.total() != header.step {
            return Err(bad("its replay segments do not reach its step".to_owned()));
        }
        if extras.observation.len() != trainer.buffers.observation.len()
            || !extras.observation.iter().all(|value| value.is_finite())
        {
            return Err(bad("its observation has the wrong length or is not finite".to_owned()));
        }
        trainer.buffers.observation = extras.observation;
        if !trainer.sums.set_values(&extras.sums) {
            return Err(bad("its sums have the wrong length".to_owned()));
        }
        trainer.parts.environment.load_state(&extras.environment)?;
        trainer.step = header.step;
        trainer.clock.last_step = header.step;
        trainer.clock.last_updates = header.updates;
        trainer.segments = header.segments;
        trainer.policy_stream = header.policy_stream;
        trainer.warmup_stream = header.warmup_stream;
        trainer.beginning = header.beginning;
        trainer.best = header.best;
        trainer.last_evaluation = header.last_evaluation;
        trainer.metrics.cut_back()?;
        Ok(trainer)
    }
}
