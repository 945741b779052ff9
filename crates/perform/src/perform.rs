//! The loop that plays: observe, act, step, record.

use std::sync::atomic::{AtomicBool, Ordering};

use etude_task::{ACTION_LEN, History, Piece, Player, TargetRange, TaskConfig, layout, observe};

use crate::error::PerformError;
use crate::performance::{Ending, Performance};
use crate::rig::{Command, Rig, RigState};
use crate::{Recorder, RecordingWriter};

/// The fault of a player whose action is no number.
const NO_ACTION: &str = "the player's action is not a finite number: check its policy";

/// Plays `piece` once from its beginning. `task` is the task that `player` was trained in and `rig` was made for: it decides the
/// columns of the observation. `writer` receives the recording, if there is one; `interrupt` ends the performance before the next
/// control step.
///
/// # Errors
/// If a robot does not hold still in the starting pose, or the recording cannot be written. A fault of a robot during the
/// performance is not an error but an [`Ending`]. Without a fault the robot still has power afterwards and holds its pose.
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
    let piece = performance.piece.clone();
    let range = TargetRange::new(&piece);
    let mut observation = vec![0.0; layout(task).len()];
    let mut action = [0.0; ACTION_LEN];
    let RigState { joints, set_points, .. } = rig.state();
    let mut history = History::at_rest(task.observed(joints, set_points), &range, 0);
    for step in 0..piece.steps() {
        if interrupt.load(Ordering::Relaxed) {
            return Ok(Ending::Interrupted);
        }
        let RigState { joints, set_points, keys } = rig.state();
        let joints = task.observed(joints, set_points);
        observe(task, &joints, &history, keys, &piece, step, &mut observation);
        rig.run_while(&mut || player.act(step, &observation, &mut action));
        // The filters of a target would keep it for the rest of the song.
        if !action.iter().all(|value| value.is_finite()) {
            return Ok(Ending::Fault(NO_ACTION.to_string()));
        }
        history.push(joints, &action);
        let targets = range.targets(&action, step);
        let command = Command { step, observation: &observation, action: &action, targets };
        match rig.step(&command, recorder)? {
            Ok(stepped) => performance.push(stepped),
            Err(ending) => return Ok(ending),
        }
    }
    Ok(Ending::Complete)
}
