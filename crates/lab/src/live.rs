//! Playing a song in simulation for a viewer of the world.

use std::sync::atomic::{AtomicBool, Ordering};

use etude_music::Song;
use etude_perform::{
    Command, Ending, PerformError, Performance, Recorder, Rig, Seen, SimRig, Stepped, perform,
};
use etude_stage::World;
use etude_task::Piece;

use crate::play::PlayError;
use crate::player::Player;

/// A simulation that is shown at its start and after each control step, for as long as `show` returns `true`.
struct Shown<'a> {
    rig: SimRig,
    show: &'a mut dyn FnMut(&World) -> bool,
    closed: &'a AtomicBool,
}

impl Shown<'_> {
    fn show(&mut self) {
        if !(self.show)(self.rig.world()) {
            self.closed.store(true, Ordering::Relaxed);
        }
    }
}

impl Rig for Shown<'_> {
    fn begin(&mut self) -> Result<(), PerformError> {
        self.rig.begin()?;
        self.show();
        Ok(())
    }

    fn seen(&self) -> Seen {
        self.rig.seen()
    }

    fn step(
        &mut self,
        command: &Command<'_>,
        recorder: &mut Recorder<'_>,
    ) -> Result<Result<Stepped, Ending>, PerformError> {
        let stepped = self.rig.step(command, recorder)?;
        self.show();
        Ok(stepped)
    }

    fn rest(&mut self) {
        self.rig.rest();
    }

    fn finish(
        &mut self,
        performance: &mut Performance,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), PerformError> {
        self.rig.finish(performance, recorder)
    }
}

/// Plays the song in the nominal world again and again, and shows the world at the start and after each control step,
/// until `show` returns `false`.
///
/// # Errors
/// If the song does not fit the keyboard, or the task cannot be built.
pub fn play_live(
    song: &Song,
    player: &Player,
    show: &mut dyn FnMut(&World) -> bool,
) -> Result<(), PlayError> {
    let task = player.config.task.without_randomness();
    let piece = Piece::new(song, task.initial_silence_secs)?;
    let closed = AtomicBool::new(false);
    let mut ready = player.ready(&task, &piece)?;
    let mut rig = Shown { rig: SimRig::nominal(&task, &piece)?, show, closed: &closed };
    while !closed.load(Ordering::Relaxed) {
        perform(&mut rig, &mut ready, &task, &piece, None, &closed)?;
    }
    Ok(())
}
