//! The loop that plays: observe, act, step, record.

use std::sync::atomic::{AtomicBool, Ordering};

use etude_task::{ACTION_LEN, Piece, Player, Stepper, TaskConfig, layout};

use crate::error::PerformError;
use crate::performance::{Ending, Performance};
use crate::rig::Rig;
use crate::{Recorder, RecordingWriter};

/// The fault of a player whose action is no number.
const NO_ACTION: &str = "the player's action is not a finite number: check its policy";

/// Plays `piece` once from its beginning. `task` is the task that `player` was trained in and `rig`
/// was made for: it decides the columns of the observation. `writer` receives the recording, if
/// there is one; `interrupt` ends the performance before the next control step.
///
/// # Errors
/// If a robot does not hold still in the starting pose, the piece was not planned for the task, or
/// the recording cannot be written. A fault of a robot during the performance is not an error but
/// an [`Ending`]. Without a fault the robot still has power afterwards and holds its pose.
pub fn perform(
    rig: &mut dyn Rig,
    player: &mut dyn Player,
    task: &TaskConfig,
    piece: &Piece,
    writer: Option<&mut RecordingWriter>,
    interrupt: &AtomicBool,
) -> Result<Performance, PerformError> {
    let mut performance = Performance::new(piece);
    let mut recorder = Recorder::new(writer);
    rig.begin()?;
    performance.down_before = rig.state().keys;
    let played = play(rig, player, task, &mut performance, &mut recorder, interrupt);
    rig.rest();
    // What the robot reported must be in the recording, above all if it refused a command.
    let finished = rig.finish(&mut performance, &mut recorder);
    performance.ending = played?;
    finished?;
    performance.events = recorder.events;
    Ok(performance)
}

/// The control steps of [`perform`].
fn play(
    rig: &mut dyn Rig,
    player: &mut dyn Player,
    task: &TaskConfig,
    performance: &mut Performance,
    recorder: &mut Recorder<'_>,
    interrupt: &AtomicBool,
) -> Result<Ending, PerformError> {
    let mut stepper = Stepper::new(task, &performance.piece, &rig.state())?;
    let mut observation = vec![0.0; layout(task).len()];
    let mut action = [0.0; ACTION_LEN];
    while !stepper.is_over() {
        if interrupt.load(Ordering::Relaxed) {
            return Ok(Ending::Interrupted);
        }
        let (state, step) = (rig.state(), stepper.next_step());
        stepper.observe(&state, &mut observation);
        rig.run_while(&mut || player.act(step, &observation, &mut action));
        // The filters of a target would keep it for the rest of the song.
        if !action.iter().all(|value| value.is_finite()) {
            return Ok(Ending::Fault(NO_ACTION.to_string()));
        }
        match rig.step(&stepper.command(&action), &observation, recorder)? {
            Ok(played) => performance.push(played),
            Err(ending) => return Ok(ending),
        }
        stepper.advance(&state, &action);
    }
    Ok(Ending::Complete)
}
