//! Evaluation: the whole song, from the beginning, without exploration; for the trainer, and in worlds of one's choice.

use etude_learn::{Evaluator, Score};
use etude_stage::PhysicalParams;

use crate::environment::Environment;
use crate::performance::{Act, Performance, play};
use crate::{Piece, TaskConfig, TaskError, layout};

/// Plays the song once per evaluation, always in the nominal world, and scores it.
pub struct SongEvaluator {
    environment: Environment,
    piece: Piece,
    observation_len: usize,
}

impl SongEvaluator {
    /// An evaluator for `piece`.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn new(config: &TaskConfig, piece: &Piece) -> Result<Self, TaskError> {
        let config = still(config);
        let observation_len = layout(&config).len();
        Ok(Self { environment: Environment::new(&config, piece, 0)?, piece: piece.clone(), observation_len })
    }
}

/// Plays the whole song once from the beginning in the world `params`, calling `act` for each action.
///
/// # Errors
/// If the configuration is not sound.
pub fn rehearse_in(
    config: &TaskConfig,
    piece: &Piece,
    params: &PhysicalParams,
    act: &mut Act<'_>,
) -> Result<Performance, TaskError> {
    let config = still(config);
    let mut environment = Environment::new(&config, piece, 0)?;
    environment.reset_in(params);
    Ok(play(&mut environment, piece, layout(&config).len(), act, &mut |_, _, _| {}))
}

/// The task without anything random in it: from the beginning, in the nominal world.
pub fn still(config: &TaskConfig) -> TaskConfig {
    let mut config = TaskConfig { random_start: false, ..config.clone() };
    config.randomisation.intensity = 0.0;
    config
}

impl Evaluator for SongEvaluator {
    fn evaluate(&mut self, act: &mut dyn FnMut(&[f32], &mut [f32])) -> Vec<Score> {
        self.environment.reset();
        let mut act_on = |_: &Environment, observation: &[f32], action: &mut [f32; crate::ACTION_LEN]| {
            act(observation, action);
        };
        let performance =
            play(&mut self.environment, &self.piece, self.observation_len, &mut act_on, &mut |_, _, _| {});
        let frame = performance.frame_scores();
        let note = performance.note_scores();
        let scores = [
            ("f1", frame.f1),
            ("precision", frame.precision),
            ("recall", frame.recall),
            ("pooled_f1", frame.pooled_f1),
            ("onset_f1", note.onset_f1),
            ("onset_offset_f1", note.onset_offset_f1),
            ("collision_free", performance.collision_free),
            ("return", performance.reward),
        ];
        scores.map(|(name, value)| Score { name: name.to_string(), value }).to_vec()
    }
}
