//! How long a control step of a policy takes.

use std::time::Instant;

use etude_learn::Policy;
use etude_music::Song;
use etude_task::{ACTION_LEN, History, Piece, TargetRange, TaskConfig, TaskError, layout, observe};

/// Mean time in which `policy` sees and acts in a control step of `song`, on one core, s: from joint readings and keys to the joint
/// targets. Measured for about `secs`.
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
    let range = TargetRange::new(&piece);
    let mut observation = vec![0.0; layout(task).len()];
    let mut action = [0.0; ACTION_LEN];
    let mut joints = range.targets(&action, 0);
    let mut history = History::at_rest(joints, &range, 0);
    let (start, mut steps) = (Instant::now(), 0u32);
    while start.elapsed().as_secs_f64() < secs {
        for step in 0..piece.steps() {
            observe(task, &joints, &history, piece.due(step), &piece, step, &mut observation);
            policy.act(&observation, &mut action);
            history.push(joints, &action);
            joints = range.targets(&action, step);
        }
        steps += piece.steps() as u32;
    }
    Ok(start.elapsed().as_secs_f64() / f64::from(steps))
}
