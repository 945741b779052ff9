//! The scripted baseline: inverse kinematics and timing, no learning.
//!
//! It turns a [`Fingering`] into joint targets that compensate lags measured in advance (`motion`,
//! `lags`), and plays them open loop, without feedback. It shows that a song can be played in this
//! world.

mod lags;
mod motion;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use etude_stage::DRIVEN_JOINTS;
pub use lags::{Lags, shortest_silences};

use crate::fingering::hand_reach::HandReach;
use crate::fingering::rail_model::RailModel;
use crate::fingering::{Fingering, UnplayedNotes};
use crate::{ACTION_LEN, Piece, TargetRange, TaskConfig, TaskError};

/// A song as joint targets, one row for each control step.
#[derive(Clone, Debug, PartialEq)]
pub struct ScriptedBaseline {
    targets: Vec<[f64; DRIVEN_JOINTS]>,
    range: TargetRange,
    unplayed: UnplayedNotes,
}

impl ScriptedBaseline {
    /// Plans `piece` for the nominal world of `config`.
    ///
    /// # Errors
    /// If a physical parameter is out of range.
    pub fn new(config: &TaskConfig, piece: &Piece) -> Result<Self, TaskError> {
        Self::new_with_progress(config, piece, &mut |_| {})
    }

    /// The same for a piece that may be long: `on_progress` receives the share of its fingering
    /// that is planned, 0 to 1.
    ///
    /// # Errors
    /// If a physical parameter is out of range, or the world in which the lags are measured cannot
    /// be built.
    pub fn new_with_progress(
        config: &TaskConfig,
        piece: &Piece,
        on_progress: &mut dyn FnMut(f64),
    ) -> Result<Self, TaskError> {
        let (stage, params) = (&config.stage, &config.params()?);
        let strokes = piece.strokes();
        let planned = || Arc::new(Fingering::plan(stage, params, config.change_steps, &strokes, on_progress));
        let fingering = piece.fingering().cloned().unwrap_or_else(planned);
        let reach = HandReach::new(stage.side, params);
        let rail = RailModel::new(stage, params);
        let lags = Lags::measure(stage, params)?;
        let targets = motion::targets((&reach, &rail, &lags, params), &fingering);
        Ok(Self { targets, range: TargetRange::new(piece), unplayed: fingering.unplayed().clone() })
    }

    /// Joint targets of control step `step`: encoder readings in rad, the rail in m. After the end,
    /// those of the last step.
    pub fn targets(&self, step: usize) -> [f64; DRIVEN_JOINTS] {
        self.targets.get(step).or(self.targets.last()).copied().unwrap_or_default()
    }

    /// The action with these targets.
    pub fn action(&self, step: usize) -> [f32; ACTION_LEN] {
        self.range.action(&self.targets(step), step)
    }

    /// The notes that are not played as written.
    pub fn unplayed(&self) -> &UnplayedNotes {
        &self.unplayed
    }
}
