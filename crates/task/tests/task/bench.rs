//! What the tests share: short songs, configurations that stress the promise of reproducibility,
//! and random actions.

use etude_learn::{StepBatch, VectorEnvironment};
use etude_music::{KeySet, Note, Song};
use etude_task::{
    ACTION_LEN, Environment, PianoVectorEnv, Piece, Player, RandomisationConfig, TaskConfig, layout,
};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Two notes in a second; episodes of thirty-one control steps with half a second of silence.
pub fn short_piece() -> Piece {
    let note = |pitch, start_secs| Note { pitch, velocity: 80, start_secs, end_secs: start_secs + 0.4 };
    let song = Song::new("short", vec![note(60, 0.0), note(61, 0.5)], 1.0).unwrap();
    Piece::new(&song, 0.5).unwrap()
}

/// The nominal task for [`short_piece`].
pub fn nominal() -> TaskConfig {
    TaskConfig { initial_silence_secs: 0.5, ..TaskConfig::default() }
}

/// Randomised worlds.
pub fn restless() -> TaskConfig {
    TaskConfig { randomisation: RandomisationConfig { intensity: 0.5, ..Default::default() }, ..nominal() }
}

/// Plays `piece` once in the nominal world: the keys that sound at the end of each control step.
pub fn play_nominal(config: &TaskConfig, piece: &Piece, player: &mut dyn Player) -> Vec<KeySet> {
    let mut environment = Environment::new(&config.without_randomness(), piece, 0).unwrap();
    let mut parts = vec![0.0; environment.reward().names().len()];
    let mut observation = vec![0.0; layout(config).len()];
    let mut action = [0.0; ACTION_LEN];
    (0..piece.steps())
        .map(|step| {
            environment.observe(&mut observation);
            player.act(step, &observation, &mut action);
            environment.step(&action, &mut parts).pressed
        })
        .collect()
}

/// Actions near the middle of the keyboard that change every few steps, the same for the same seed.
pub struct Actions {
    random: Pcg64,
    step: usize,
    current: Vec<f32>,
}

impl Actions {
    /// For `num_envs` environments.
    pub fn new(num_envs: usize, seed: u64) -> Self {
        Self { random: Pcg64::seed_from_u64(seed), step: 0, current: vec![0.0; num_envs * ACTION_LEN] }
    }

    /// Actions of the next step.
    pub fn next(&mut self) -> &[f32] {
        if self.step.is_multiple_of(3) {
            for (index, value) in self.current.iter_mut().enumerate() {
                // The rail stays near the middle, where there are keys under all fingers.
                let scale = if index % ACTION_LEN == ACTION_LEN - 1 { 0.3 } else { 1.0 };
                *value = scale * self.random.random_range(-1.0f32..=1.0);
            }
        }
        self.step += 1;
        &self.current
    }
}

/// An empty batch for `piano`.
pub fn batch(piano: &PianoVectorEnv) -> StepBatch {
    StepBatch::new(piano.num_envs(), piano.layout(), piano.reward_term_names().len())
}

/// Plays `steps` and returns every batch.
pub fn play(piano: &mut PianoVectorEnv, actions: &mut Actions, steps: usize) -> Vec<StepBatch> {
    let mut batch = batch(piano);
    (0..steps)
        .map(|_| {
            piano.step(actions.next(), &mut batch);
            batch.clone()
        })
        .collect()
}
