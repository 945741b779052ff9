//! Playing a song for someone who watches the world as it moves.

use etude_music::Song;
use etude_stage::World;
use etude_task::{ACTION_LEN, Environment, Piece, layout, still};

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
    // The world that the window shows.
    let task = still(&player.config.task);
    let piece = Piece::new(song, task.initial_silence_secs)?;
    let mut environment = Environment::new(&task, &piece, player.config.trainer.seed)?;
    let (mut act, _) = player.mind.act(&task, &piece)?;
    let mut observation = vec![0.0; layout(&task).len()];
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
