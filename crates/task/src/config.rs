//! Configuration of the task.

use std::collections::BTreeMap;

use etude_music::SongError;
use etude_stage::{ParamError, PhysicalParams, StageConfig, StageError};
use serde::{Deserialize, Serialize};

use crate::observation::ObservationScale;
use crate::randomise::RandomisationConfig;

/// Which decision process to build on which world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TaskConfig {
    /// The world.
    pub stage: StageConfig,
    /// Physical numbers other than the defaults, by path.
    pub physics: BTreeMap<String, f64>,
    /// Weights of reward terms other than the main text's, by name.
    pub reward: BTreeMap<String, f64>,
    /// Domain randomisation.
    pub randomisation: RandomisationConfig,
    /// Silence before the first note, s.
    pub initial_silence_secs: f64,
    /// Control steps of the sheet shown beyond the current one.
    pub lookahead: usize,
    /// Whether the observation holds the joints of one step ago (main text) or not (appendix).
    pub previous_joints: bool,
    /// Scale of the joint readings in the observation.
    pub scale: ObservationScale,
    /// Whether training episodes start anywhere in the song. Evaluation always plays the whole song.
    pub random_start: bool,
}

impl Default for TaskConfig {
    fn default() -> Self {
        Self {
            stage: StageConfig::default(),
            physics: BTreeMap::new(),
            reward: BTreeMap::new(),
            randomisation: RandomisationConfig::default(),
            initial_silence_secs: 1.0,
            lookahead: 5,
            previous_joints: true,
            scale: ObservationScale::default(),
            random_start: false,
        }
    }
}

/// A task could not be built.
#[derive(Debug, thiserror::Error)]
pub enum TaskError {
    /// The world could not be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// A physical number is unknown or out of range.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// The song cannot be played here.
    #[error(transparent)]
    Song(#[from] SongError),
    /// No reward term has this name.
    #[error("no reward term is called `{0}`; there are: {list}", list = term_names())]
    UnknownTerm(String),
    /// A weight is not a number.
    #[error("the weight of reward term `{0}` is {1}; it must be a finite number")]
    BadWeight(String, f64),
    /// A half-width of the randomisation is not a number of at least 0.
    #[error(
        "task.randomisation.widths: {0} = {1} must be a finite number of at least 0, in the unit of the row; \
         `etude model params` lists the rows"
    )]
    BadWidth(String, f64),
    /// A number of the task itself is out of range.
    #[error("task.{name} = {value} must lie in {low} … {high}")]
    OutOfRange {
        /// Key of the config.
        name: &'static str,
        /// Refused value.
        value: f64,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
}

fn term_names() -> String {
    let names: Vec<_> = crate::reward::TERMS.iter().map(|term| term.name).collect();
    names.join(", ")
}

impl TaskConfig {
    /// The physical numbers of the nominal world.
    ///
    /// # Errors
    /// If a path is unknown or a value out of its range.
    pub fn params(&self) -> Result<PhysicalParams, ParamError> {
        PhysicalParams::default().with(&self.physics)
    }

    /// The same task without anything random: from the beginning of the song, in the nominal world.
    pub fn without_randomness(&self) -> Self {
        let mut config = Self { random_start: false, ..self.clone() };
        config.randomisation.intensity = 0.0;
        config
    }

    /// Checks the numbers that only the task knows.
    ///
    /// # Errors
    /// Names the first one that is out of range.
    pub fn check(&self) -> Result<(), TaskError> {
        let limits = [
            ("randomisation.intensity", self.randomisation.intensity, 0.0, 1.0),
            ("initial_silence_secs", self.initial_silence_secs, 0.0, 60.0),
            ("lookahead", self.lookahead as f64, 0.0, 40.0),
        ];
        for (name, value, low, high) in limits {
            if !(low..=high).contains(&value) {
                return Err(TaskError::OutOfRange { name, value, low, high });
            }
        }
        Ok(())
    }
}
