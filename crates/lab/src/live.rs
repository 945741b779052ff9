//! Playing a song for someone who watches the world as it moves.

use etude_music::Song;
use etude_stage::World;
use etude_task::{ACTION_LEN, Environment, Piece, layout};

use crate::play::PlayError;
use crate::player::Player;

/// Plays the song in simulation, again and again, and shows the world at the start and after each control step, for as long
/// as `show` returns `true`.
///
/// # Errors
/// If the song does not fit the keyboard, or the task cannot be built.
pub fn play_live(
    song: &Song,
    player: &mut Player,
    show: &mut dyn FnMut(&World) -> bool,
) -> Result<(), PlayError> {
    let mut config = player.config.clone();
    // From the beginning, and in the world that the window shows.
    config.task.random_start = false;
    config.task.randomisation.intensity = 0.0;
    let piece = Piece::new(song, config.task.initial_silence_secs)?;
    let mut environment = Environment::new(&config.task, &piece, config.trainer.seed)?;
    let (mut act, _) = player.mind.act(&config.task, &piece)?;
    let mut observation = vec![0.0; layout(&config.task).len()];
    let mut parts = vec![0.0; environment.reward().names().len()];
    let mut action = [0.0; ACTION_LEN];
    while show(environment.world()) {
        environment.observe(&mut observation);
        act(&environment, &observation, &mut action);
        if environment.step(&action, &mut parts).song_over {
            environment.reset();
        }
    }
    Ok(())
}
