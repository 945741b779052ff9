//! Evaluation during a training: the whole song in the nominal world, without exploration.

use std::sync::atomic::AtomicBool;

use etude_learn::{Evaluator, Score};
use etude_task::{ACTION_LEN, Piece, TaskConfig, TaskError};

use crate::{SimRig, perform};

/// Names of the scores of [`SongEvaluator`]. `overall` is the mean of the paper's F1 and the F1 of the notes' onsets.
pub const SCORES: [&str; 9] = [
    "f1",
    "precision",
    "recall",
    "pooled_f1",
    "onset_f1",
    "onset_offset_f1",
    "overall",
    "collision_free",
    "return",
];

/// Plays the song once for each evaluation, always in the nominal world, and scores it.
pub struct SongEvaluator {
    rig: SimRig,
    task: TaskConfig,
    piece: Piece,
}

impl SongEvaluator {
    /// An evaluator for `piece`.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn new(task: &TaskConfig, piece: &Piece) -> Result<Self, TaskError> {
        Ok(Self { rig: SimRig::nominal(task, piece)?, task: task.clone(), piece: piece.clone() })
    }
}

impl Evaluator for SongEvaluator {
    fn evaluate(&mut self, act: &mut dyn FnMut(&[f32], &mut [f32])) -> Vec<Score> {
        let mut player =
            |_: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]| act(observation, action);
        let never = AtomicBool::new(false);
        let performance = perform(&mut self.rig, &mut player, &self.task, &self.piece, None, &never)
            .expect("a simulation has no recording here that could fail");
        let (scores, simulated) = (performance.scores(), performance.simulation.unwrap_or_default());
        let values = [
            scores.frame.f1,
            scores.frame.precision,
            scores.frame.recall,
            scores.frame.pooled_f1,
            scores.note.onset_f1,
            scores.note.onset_offset_f1,
            (scores.frame.f1 + scores.note.onset_f1) / 2.0,
            simulated.collision_free,
            simulated.reward,
        ];
        SCORES.into_iter().zip(values).map(|(name, value)| Score { name: name.to_string(), value }).collect()
    }
}
