//! How long a control step of a policy takes.

use std::time::Instant;

use etude_learn::Policy;
use etude_music::{KeySet, Song};
use etude_task::{ACTION_LEN, Piece, RigState, Stepper, TargetRange, TaskConfig, TaskError, layout};

/// Mean time in which `policy` sees and acts in a control step of `song`, on one core, s: from
/// joint readings and keys to the joint targets. Measured for about `secs`.
///
/// # Errors
/// If the task is not sound.
pub(super) fn control_step_secs(
    policy: &mut Policy,
    task: &TaskConfig,
    song: &Song,
    secs: f64,
) -> Result<f64, TaskError> {
    let piece = Piece::for_task(song, task)?;
    let mut observation = vec![0.0; layout(task).len()];
    let mut action = [0.0; ACTION_LEN];
    let joints = TargetRange::new(&piece).targets(&action, 0);
    let mut state = RigState { joints, set_points: joints, keys: KeySet::EMPTY };
    let mut stepper = Stepper::new(task, &piece, &state)?;
    let (start, mut steps) = (Instant::now(), 0u32);
    while start.elapsed().as_secs_f64() < secs {
        stepper.begin(&state);
        while !stepper.is_over() {
            state.keys = piece.due(stepper.position());
            stepper.observe(&state, &mut observation);
            policy.act(&observation, &mut action);
            let joints = stepper.command(&action).targets;
            stepper.advance(&state, &action);
            (state.joints, state.set_points) = (joints, joints);
        }
        steps += piece.steps() as u32;
    }
    Ok(start.elapsed().as_secs_f64() / f64::from(steps))
}
