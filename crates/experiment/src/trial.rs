//! A trial: one unit of an experiment's work, with an id that depends on what is done and not on
//! the experiment.
//!
//! Two experiments that need the same training share its trial. A plan that is made again has the
//! same ids, as long as its songs, resolved configurations and twin parameters are the same.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use etude_lab::{
    IdentifyMethod, RunConfig, beginning_with, load_player, policy_called, resolve, set_latency_compensation,
    slug,
};
use etude_learn::TrainerConfig;
use etude_learn::seed::fnv;
use serde::{Deserialize, Serialize};

use crate::config::{PerformConfig, RehearseConfig};

/// One unit of an experiment's work.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Name of its folder below `runs`; the same work has the same id.
    pub id: String,
    /// Its place in the experiment: `song`, `variant`, `seed`, the keys of the grid, `mode`,
    /// `twin_params`, `method`, `player`, `pieces`.
    pub labels: BTreeMap<String, String>,
    /// The work.
    pub work: TrialWork,
}

impl Trial {
    /// Whether its settings name the latency compensation.
    pub(crate) fn sets_latency_compensation(&self) -> bool {
        match &self.work {
            TrialWork::Train { training, .. } => set_latency_compensation(&training.set),
            _ => false,
        }
    }
}

/// The work of a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum TrialWork {
    /// A song or a corpus is learned and, with `perform`, the song is played on the twin; with
    /// `rehearse` its policy goes through Sim2Real2Sim.
    Train {
        /// How it is learned.
        training: TrainingConfig,
        /// How it is played.
        perform: Option<PerformConfig>,
        /// How it is rehearsed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        rehearse: Option<RehearseConfig>,
    },
    /// A player that is ready plays.
    Play {
        /// A built-in id, a MIDI file, or a melody by its seed: `melody-7`.
        song: String,
        /// `scripted`, the name of a policy that comes with Étude, a policy's file, or the folder
        /// of a run.
        player: String,
        /// How it is played on the twin.
        perform: Option<PerformConfig>,
        /// Seed of the twin's noise.
        seed: u64,
    },
    /// The simulator is fitted to the twin's excitations.
    Identify {
        /// Parameter set of the twin: a name or a file.
        twin_params: String,
        /// The method.
        method: IdentifyMethod,
        /// Evaluations of each fit at most.
        evaluations: Option<u64>,
        /// Owns every random draw.
        seed: u64,
    },
}

/// A training, by the layers of its configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingConfig {
    /// A built-in id, a MIDI file, or a melody by its seed: `melody-7`; none where a corpus is
    /// learned.
    pub song: Option<String>,
    /// The preset.
    pub preset: String,
    /// Overrides, `path=value`, the seed included.
    pub set: Vec<String>,
    /// What it begins with: the name of a policy that comes with Étude, a policy's file, or the
    /// folder of a run, of which the best policy is taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
}

impl TrainingConfig {
    /// The configuration that results from its layers.
    ///
    /// # Errors
    /// As [`resolve`](fn@resolve), and if a setting cannot work.
    pub fn resolve(&self) -> anyhow::Result<RunConfig> {
        let mut config = resolve(&self.preset, None, &self.set)?;
        if let Some(source) = self.source()? {
            config = beginning_with(config, &source);
        }
        let config = config.complete();
        config.check()?;
        config.task.check()?;
        config.task.params()?;
        etude_task::reward::Reward::new(&config.task.reward)?;
        Ok(config)
    }

    /// The file of the policy that it begins with.
    ///
    /// # Errors
    /// If there is none, or it cannot be used.
    pub fn source(&self) -> anyhow::Result<Option<PathBuf>> {
        let Some(name) = &self.from else { return Ok(None) };
        Ok(load_player(&policy_called(Path::new(name))?)?.file().map(Path::to_path_buf))
    }
}

/// What distinguishes one training from another: notes and resolved configuration, without threads
/// and the intervals of logs and checkpoints, which do not change the result.
pub(crate) fn fingerprint(notes: &str, config: &RunConfig) -> String {
    let defaults = TrainerConfig::default();
    let trainer = TrainerConfig {
        threads: defaults.threads,
        overlap: defaults.overlap,
        log_every_steps: defaults.log_every_steps,
        checkpoint_every_steps: defaults.checkpoint_every_steps,
        ..config.trainer.clone()
    };
    let config = RunConfig { trainer, ..config.clone() };
    notes.to_string() + &json(&config)
}

/// A value as JSON, on one line.
pub(crate) fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value)
        .expect("configurations and trials are numbers, strings, lists and maps with string keys")
}

/// The id of a trial; `all` holds everything that its result depends on.
pub(crate) fn id(kind: &str, what: &str, seed: u64, all: &str) -> String {
    let stem =
        Path::new(what).file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    format!("{kind}__{}__{seed}__{:016x}", slug(&stem), fnv(all.as_bytes()))
}
