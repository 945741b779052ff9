//! A performance: what was due, what was pressed, and what that is worth.

use etude_music::metrics::{FrameScores, NoteScores, frame_scores, note_scores};
use etude_music::{CONTROL_HZ, KeyEvent, KeySet, Note, notes_from_key_events};

use crate::environment::Environment;
use crate::{ACTION_LEN, Piece, TaskConfig, TaskError};

/// One whole song as it was played.
#[derive(Clone, Debug)]
pub struct Performance {
    /// Keys due at each control step.
    pub due: Vec<KeySet>,
    /// Keys that sounded at the end of each control step.
    pub pressed: Vec<KeySet>,
    /// Strikes and releases at the time of their physics step.
    pub events: Vec<KeyEvent>,
    /// The notes that were due.
    pub reference: Vec<Note>,
    /// Sum of the rewards.
    pub reward: f64,
    /// Fraction of control steps with a collision-free hand.
    pub collision_free: f64,
}

impl Performance {
    /// The paper's scores and the pooled ones.
    pub fn frame_scores(&self) -> FrameScores {
        frame_scores(&self.due, &self.pressed)
    }

    /// Scores by notes, with onsets read at physics resolution.
    pub fn note_scores(&self) -> NoteScores {
        note_scores(&self.reference, &self.notes())
    }

    /// The notes that were played.
    pub fn notes(&self) -> Vec<Note> {
        notes_from_key_events(&self.events, self.pressed.len() as f64 / CONTROL_HZ)
    }
}

/// Chooses an action from the environment and its observation.
pub type Act<'a> = dyn FnMut(&Environment, &[f32], &mut [f32; ACTION_LEN]) + 'a;
/// Sees the environment after each step, the action that led there, and the weighted reward terms it earned.
pub type Watch<'a> = dyn FnMut(&Environment, &[f32; ACTION_LEN], &[f32]) + 'a;

/// Plays the whole song once from the beginning in the nominal world (or, with `randomisation`, in the world that
/// `seed` draws), calling `act` for each action and `watch` after each step.
///
/// # Errors
/// If the configuration is not sound.
pub fn rehearse(
    config: &TaskConfig,
    piece: &Piece,
    seed: u64,
    act: &mut Act<'_>,
    watch: &mut Watch<'_>,
) -> Result<Performance, TaskError> {
    let mut config = TaskConfig { random_start: false, ..config.clone() };
    // There is no training whose steps a curriculum could count.
    config.randomisation.curriculum_steps = 0;
    let mut environment = Environment::new(&config, piece, seed)?;
    Ok(play(&mut environment, piece, crate::layout(&config).len(), act, watch))
}

/// Plays the rest of an episode that has just been reset.
pub(crate) fn play(
    environment: &mut Environment,
    piece: &Piece,
    observation_len: usize,
    act: &mut Act<'_>,
    watch: &mut Watch<'_>,
) -> Performance {
    let mut observation = vec![0.0; observation_len];
    let mut action = [0.0; ACTION_LEN];
    let mut parts = vec![0.0; environment.reward().names().len()];
    let mut performance = Performance {
        due: piece.frames().to_vec(),
        pressed: Vec::with_capacity(piece.steps()),
        events: Vec::new(),
        reference: piece.notes().to_vec(),
        reward: 0.0,
        collision_free: 0.0,
    };
    loop {
        environment.observe(&mut observation);
        act(environment, &observation, &mut action);
        let step = environment.step(&action, &mut parts);
        performance.pressed.push(environment.pressed());
        performance.events.extend_from_slice(environment.world().events());
        performance.reward += step.reward;
        if !step.collided {
            performance.collision_free += 1.0 / piece.steps() as f64;
        }
        watch(environment, &action, &parts);
        if step.song_over {
            return performance;
        }
    }
}
