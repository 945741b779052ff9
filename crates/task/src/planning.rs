//! From a song to a piece: when its keys are due, and which fingers play them.

use etude_music::Song;

use crate::fingering::Fingering;
use crate::{Piece, TaskConfig, TaskError};

impl Piece {
    /// The song as `config` plays it: with its key schedule, after its initial silence and, if it
    /// asks for one, with a fingering for its world.
    ///
    /// # Errors
    /// As [`Piece::new`]; also if a parameter of the schedule or of the physics is out of range.
    pub fn for_task(song: &Song, config: &TaskConfig) -> Result<Self, TaskError> {
        Self::for_task_with_progress(song, config, &mut |_| {})
    }

    /// The same for a song that may be long: `on_progress` receives the share of its fingering that
    /// is planned, 0 to 1.
    ///
    /// # Errors
    /// As [`Piece::for_task`].
    pub fn for_task_with_progress(
        song: &Song,
        config: &TaskConfig,
        on_progress: &mut dyn FnMut(f64),
    ) -> Result<Self, TaskError> {
        let piece = Self::from(config.plan.schedule(song, config.initial_silence_secs)?);
        if !config.fingering {
            return Ok(piece);
        }
        let (stage, params) = (&config.stage, &config.params()?);
        let strokes = piece.strokes();
        let mut fingering = Fingering::plan(stage, params, config.change_steps, &strokes, on_progress)
            .with_rail_range(config.rail_range);
        if config.finger_range > 0.0 {
            fingering = fingering.with_poses(stage, params, config.finger_range);
        }
        Ok(piece.with_fingering(fingering))
    }
}
