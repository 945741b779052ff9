//! The scripted player: inverse kinematics and timing, no learning.
//!
//! It is a hand-designed baseline, and shows that a song can be played in this world. It plans the whole song in advance: strokes
//! from the frames (`strokes`), fingers and rail by dynamic programming (`fingering`, with the models `comb` and `rail`), then joint
//! targets that compensate lags measured in advance (`motion`, `lags`). It plays the plan open loop, without feedback.

mod comb;
mod fingering;
mod lags;
mod limits;
mod motion;
mod rail;
mod strokes;
#[cfg(test)]
mod tests;

use etude_stage::{JOINTS, PhysicalParams, StageConfig};

use crate::{ACTION_LEN, Piece, TargetRange, TaskConfig, TaskError};

pub use limits::{Limit, LimitKind, Limits};

/// A song as joint targets, one row for each control step.
#[derive(Clone, Debug, PartialEq)]
pub struct ScriptedPlayer {
    targets: Vec<[f64; JOINTS]>,
    range: TargetRange,
    limits: Limits,
}

impl ScriptedPlayer {
    /// Plans `piece` for the nominal world of `config`.
    ///
    /// # Errors
    /// If the configuration's physical numbers are not sound.
    pub fn new(config: &TaskConfig, piece: &Piece) -> Result<Self, TaskError> {
        Self::plan(&config.stage, &config.params()?, piece)
    }

    /// Plans `piece` for this stage with these physical numbers.
    ///
    /// # Errors
    /// If the world in which the lags are measured cannot be built.
    pub fn plan(stage: &StageConfig, params: &PhysicalParams, piece: &Piece) -> Result<Self, TaskError> {
        let strokes = strokes::strokes(piece.frames());
        let slices = strokes::slices(&strokes);
        let comb = comb::Comb::new(stage.side, params);
        let rail = rail::Rail::new(stage, params);
        let planner = fingering::Planner { comb: &comb, rail: &rail, strokes: &strokes, slices: &slices };
        let plan = planner.plan();
        let notes = fingering::played(&planner, &plan);
        let lags = lags::Lags::measure(stage, params, &comb)?;
        let world = (&comb, &rail, &lags, params);
        let targets = motion::targets(world, &slices, &plan, &notes, piece.steps());
        let range = TargetRange::new(piece);
        Ok(Self { targets, range, limits: fingering::limits(&planner, &notes) })
    }

    /// Joint targets of control step `step`: encoder readings in rad, the rail in m. After the end, those of the last step.
    pub fn targets(&self, step: usize) -> [f64; JOINTS] {
        self.targets.get(step).or(self.targets.last()).copied().unwrap_or_default()
    }

    /// The action with these targets.
    pub fn action(&self, step: usize) -> [f32; ACTION_LEN] {
        self.range.action(&self.targets(step))
    }

    /// The notes that are not played as written.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }
}
