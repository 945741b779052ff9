//! Configuration of the task.

use std::collections::BTreeMap;

use etude_checks::check_range;
use etude_music::KeyScheduleConfig;
use etude_stage::{ParamError, PhysicalParams, StageConfig};
use serde::{Deserialize, Serialize};

use crate::error::TaskError;
use crate::randomise::RandomisationConfig;
use crate::reward::FINGERING_TERMS;

/// The most previous actions that an observation can show.
pub(crate) const MAX_PREVIOUS_ACTIONS: usize = 4;

/// Scale of the joint positions in the observation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObservationScale {
    /// As the paper's table has it: rad, and m for the rail.
    Si,
    /// Finger joints by their range, to [−1, 1]; the rail in white keys from the middle, so that a
    /// movement by one key is as large as the bending of a finger. Our choice: in SI units policies
    /// learn more slowly (docs/results/choices.md).
    #[default]
    Normalised,
}

/// What the observation's keys and rail are relative to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObservationView {
    /// The keyboard: all 49 keys, and the rail's position on it. The paper's.
    #[default]
    Keyboard,
    /// The hand: the keys around the rail's planned position, how far the rail is from it, and how
    /// far it moves in the next control steps. What is learned in one octave then holds in all. It
    /// needs a fingering.
    Hand,
}

/// The world and the decision process on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TaskConfig {
    /// The world.
    pub stage: StageConfig,
    /// Physical parameters other than the defaults, by path.
    pub physics: BTreeMap<String, f64>,
    /// Weights of reward terms other than the main text's, by name.
    pub reward: BTreeMap<String, f64>,
    /// Domain randomisation.
    pub randomisation: RandomisationConfig,
    /// When keys are due: how repeated keys are let go, and how early commands are sent. The
    /// default is RoboPianist's rule, which the paper uses.
    ///
    /// Its key in files and on the command line is `task.plan`.
    #[serde(rename = "plan")]
    pub key_schedule: KeyScheduleConfig,
    /// Silence before the first note, s.
    pub initial_silence_secs: f64,
    /// Control steps of the song that the observation shows beyond the current one.
    pub lookahead: usize,
    /// Whether the observation holds the joints of one step ago (main text) or not (appendix).
    pub previous_joints: bool,
    /// Previous actions that the observation shows, the newest first. 0 by default, 1 in the preset
    /// `paper`. They show the policy what is still to come of slow or late drives, whose references
    /// it does not see.
    pub previous_actions: usize,
    /// Whether the policy is shown a planned [`Fingering`](crate::Fingering) of the song: the
    /// observation has the position of each fingertip relative to its goal, and the rail's action
    /// is a distance from its planned position. The reward terms [`FINGERING_TERMS`] need it. The
    /// paper has none.
    pub fingering: bool,
    /// Control steps of silence in which a fingering lets a finger change from one key to another
    /// of the same colour. Fewer keep notes longer; more are easier to play. The default is what
    /// the scripted baseline needs.
    pub change_steps: usize,
    /// How far the target of a finger joint may be from the angle that holds the fingertip over its
    /// goal, rad; 0 stands for the joint's whole range. It needs a fingering.
    pub finger_range: f64,
    /// How far the target of the rail may be from its planned position, m, with a fingering. A
    /// policy whose targets reach farther swings the hand about its goal where the arm lags more
    /// than in its training.
    pub rail_range: f64,
    /// Whether the observation shows, with each finger's goal, the velocity of its note. It needs a
    /// fingering.
    pub velocities: bool,
    /// What the observation's keys and rail are relative to.
    pub view: ObservationView,
    /// Whether the observation has the rail's set-point instead of its measured position. A policy
    /// that reads the measured position swings about its goal if the arm lags more than in its
    /// training.
    pub rail_set_point: bool,
    /// Scale of the joint readings in the observation.
    pub scale: ObservationScale,
}

impl Default for TaskConfig {
    fn default() -> Self {
        Self {
            stage: StageConfig::default(),
            physics: BTreeMap::new(),
            reward: BTreeMap::new(),
            randomisation: RandomisationConfig::default(),
            key_schedule: KeyScheduleConfig::default(),
            initial_silence_secs: 1.0,
            lookahead: 5,
            previous_joints: true,
            previous_actions: 0,
            fingering: false,
            change_steps: 3,
            finger_range: 0.0,
            rail_range: 0.04,
            velocities: false,
            view: ObservationView::default(),
            rail_set_point: false,
            scale: ObservationScale::default(),
        }
    }
}

impl TaskConfig {
    /// The physical parameters of the nominal world.
    ///
    /// # Errors
    /// If a path is unknown or a value out of its range.
    pub fn params(&self) -> Result<PhysicalParams, ParamError> {
        PhysicalParams::default().with(&self.physics)
    }

    /// The same task in the nominal world.
    pub fn without_randomness(&self) -> Self {
        let mut config = self.clone();
        config.randomisation.intensity = 0.0;
        config
    }

    /// Checks the numbers that belong to the task itself.
    ///
    /// # Errors
    /// Names the first one that is out of range.
    pub fn check(&self) -> Result<(), TaskError> {
        let ranges = [
            ("randomisation.intensity", self.randomisation.intensity, 0.0..=1.0),
            ("initial_silence_secs", self.initial_silence_secs, 0.0..=60.0),
            ("lookahead", self.lookahead as f64, 0.0..=40.0),
            ("previous_actions", self.previous_actions as f64, 0.0..=MAX_PREVIOUS_ACTIONS as f64),
            ("change_steps", self.change_steps as f64, 1.0..=20.0),
            ("finger_range", self.finger_range, 0.0..=2.0),
            ("rail_range", self.rail_range, 0.001..=0.2),
        ];
        for (name, value, range) in ranges {
            check_range(format!("task.{name}"), value, range)?;
        }
        self.key_schedule.check()?;
        let weighs = |term: &&&str| self.reward.get(**term).is_some_and(|weight| *weight != 0.0);
        let needs_fingering = [
            (self.finger_range > 0.0).then_some("task.finger_range is around the poses of"),
            self.velocities.then_some("task.velocities shows them with the goals of"),
            (self.view == ObservationView::Hand)
                .then_some("task.view = hand shows the keys around the rail's position in"),
        ];
        let term = FINGERING_TERMS.iter().find(weighs).map(|term| format!("the reward term `{term}` needs"));
        let needs = term.or(needs_fingering.into_iter().flatten().next().map(str::to_string));
        match needs.filter(|_| !self.fingering) {
            Some(needs) => Err(TaskError::Value(format!("{needs} a fingering; set task.fingering = true"))),
            None => Ok(()),
        }
    }
}
