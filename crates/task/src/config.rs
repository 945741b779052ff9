//! Configuration of the task.

use std::collections::BTreeMap;

use etude_music::KeyScheduleConfig;
use etude_stage::{DRIVEN_JOINTS, ParamError, PhysicalParams, RAIL, StageConfig};
use serde::{Deserialize, Serialize};

use crate::error::TaskError;
use crate::observation::MOST_ACTIONS;
use crate::randomise::RandomisationConfig;

/// Scale of the joint positions in the observation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObservationScale {
    /// As the paper's table has it: rad, and m for the rail.
    Si,
    /// Finger joints by their range, to [−1, 1]; the rail in white keys from the middle, so that a movement by one key is as large
    /// as the bending of a finger. Our choice: in SI units policies learn more slowly (docs/results/choices.md).
    #[default]
    Normalised,
}

/// What the observation's keys and rail are relative to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ObservationView {
    /// The keyboard: all 49 keys, and the rail's place on it. The paper's.
    #[default]
    Keyboard,
    /// The hand: the keys around the rail's planned place, how far the rail is from that place, and how far the place moves in the next
    /// control steps. What is learned in one octave then holds in all. It needs a fingering.
    Hand,
}

/// The world and the decision process on it.
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
    /// What is due, and when: how repeated keys are let go, and how early they are struck. The default is RoboPianist's rule, which
    /// the paper uses.
    pub plan: KeyScheduleConfig,
    /// Silence before the first note, s.
    pub initial_silence_secs: f64,
    /// Control steps of the song that the observation shows beyond the current one.
    pub lookahead: usize,
    /// Whether the observation holds the joints of one step ago (main text) or not (appendix).
    pub previous_joints: bool,
    /// Previous actions that the observation shows, the newest first. The paper's is 0. They tell the policy what is still to come
    /// of slow or late drives, whose references it does not see.
    pub previous_actions: usize,
    /// Whether the policy is shown a planned [`Fingering`](crate::Fingering) of the song: the observation has the place of
    /// each fingertip relative to its goal, and the rail's action is a distance from its planned place. The reward
    /// terms of [`OF_A_FINGERING`](crate::reward::OF_A_FINGERING) need it. The paper has none.
    pub fingering: bool,
    /// Control steps of silence in which a fingering lets a finger change from one key to another of the same colour. Fewer keep notes
    /// longer; more are easier to play. The default is what the scripted baseline needs.
    pub change_steps: usize,
    /// How far the target of a finger joint may be from the angle that holds the fingertip over its goal, rad; 0 stands for the joint's
    /// whole range. It needs a fingering.
    pub finger_range: f64,
    /// How far the target of the rail may be from its planned place, m, with a fingering. A policy whose targets reach farther swings the
    /// hand about its goal where the arm lags more than in its training.
    pub rail_range: f64,
    /// Whether the observation shows, with each finger's goal, the velocity of its note. It needs a fingering.
    pub velocities: bool,
    /// What the observation's keys and rail are relative to.
    pub view: ObservationView,
    /// Whether the observation has the rail's set-point instead of its measured place. A policy that reads the measured place swings
    /// about its goal if the arm lags more than in its training. The paper's policies observe the measured place.
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
            plan: KeyScheduleConfig::default(),
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
    /// The physical numbers of the nominal world.
    ///
    /// # Errors
    /// If a path is unknown or a value out of its range.
    pub fn params(&self) -> Result<PhysicalParams, ParamError> {
        PhysicalParams::default().with(&self.physics)
    }

    /// The places of the joints to observe, of joints that are `measured` and have these set-points.
    pub fn observed(
        &self,
        measured: [f64; DRIVEN_JOINTS],
        set_points: [f64; DRIVEN_JOINTS],
    ) -> [f64; DRIVEN_JOINTS] {
        let mut places = measured;
        if self.rail_set_point {
            places[RAIL] = set_points[RAIL];
        }
        places
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
        let limits = [
            ("randomisation.intensity", self.randomisation.intensity, 0.0, 1.0),
            ("initial_silence_secs", self.initial_silence_secs, 0.0, 60.0),
            ("lookahead", self.lookahead as f64, 0.0, 40.0),
            ("previous_actions", self.previous_actions as f64, 0.0, MOST_ACTIONS as f64),
            ("change_steps", self.change_steps as f64, 1.0, 20.0),
            ("finger_range", self.finger_range, 0.0, 2.0),
            ("rail_range", self.rail_range, 0.001, 0.2),
        ];
        for (name, value, low, high) in limits {
            if !(low..=high).contains(&value) {
                return Err(TaskError::Value(format!("task.{name} = {value} must lie in {low} … {high}")));
            }
        }
        self.plan.check()?;
        let needs = |term: &&&str| self.reward.get(**term).is_some_and(|weight| *weight != 0.0);
        if let Some(term) = crate::reward::OF_A_FINGERING.iter().find(needs).filter(|_| !self.fingering) {
            return Err(TaskError::Value(format!(
                "the reward term `{term}` needs a fingering; set task.fingering = true"
            )));
        }
        if self.finger_range > 0.0 && !self.fingering {
            return Err(TaskError::Value(
                "task.finger_range is around the pose that a fingering plans; set task.fingering = true"
                    .to_string(),
            ));
        }
        if self.velocities && !self.fingering {
            return Err(TaskError::Value(
                "task.velocities shows them with the goals of a fingering; set task.fingering = true"
                    .to_string(),
            ));
        }
        if self.view == ObservationView::Hand && !self.fingering {
            return Err(TaskError::Value(
                "task.view = hand shows the keys around the rail's planned place; set task.fingering = true"
                    .to_string(),
            ));
        }
        Ok(())
    }
}
