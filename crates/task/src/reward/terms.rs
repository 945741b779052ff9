//! The terms of the paper's main text, and ours that need no fingering.

use std::ops::Range;

use etude_music::KEY_COUNT;
use etude_stage::{FINGERS, RAIL};

use super::context::{StepContext, distance, tolerance};
use crate::{ACTION_LEN, assign};

/// Weight of the rail's power relative to that of the fingers, as in
/// lasr-lab/learning-to-play-piano.
const RAIL_SHARE: f64 = 0.003;

/// Minus the power of the fingers and, scaled down, of the rail, W.
pub(super) fn energy(context: &StepContext) -> f64 {
    -(context.outcome.finger_power + RAIL_SHARE * context.outcome.rail_power)
}

/// Minus the mean squared difference to the previous action.
pub(super) fn action_change(context: &StepContext) -> f64 {
    let squares = context.action.iter().zip(context.previous_action).map(|(a, b)| f64::from(a - b).powi(2));
    -squares.sum::<f64>() / ACTION_LEN as f64
}

/// Minus the squared travel of the keys that are not due, summed: the penalty for wrong keys. A key
/// that sounded before the step counts at its end, any other where it was deepest: a neighbour that
/// a finger brushes is heard, even if it is up again at the end. `key_press` rewards neither
/// lifting one of two wrong keys nor lifting a key half; this does.
pub(super) fn wrong_travel(context: &StepContext) -> f64 {
    let travel = |key| {
        let was_down = context.pressed_before.contains(key);
        if was_down { context.world.key_travel(key) } else { context.world.deepest_travel(key) }
    };
    let wrong = (0..KEY_COUNT).filter(|key| !context.due.contains(*key));
    -wrong.map(|key| travel(key).clamp(0.0, 1.0).powi(2)).sum::<f64>()
}

/// 0.5 × how far down the keys to hold are, plus 0.5 if no key sounds that is not due. Without a
/// fingering all due keys are to hold, as in RoboPianist.
pub(super) fn key_press(context: &StepContext) -> f64 {
    let to_hold = context.to_hold;
    let closeness: f64 =
        to_hold.iter().map(|key| tolerance((1.0 - context.world.key_travel(key)).max(0.0), 0.05, 0.5)).sum();
    let right = if to_hold.is_empty() { 0.0 } else { closeness / to_hold.len() as f64 };
    let clean = context.world.pressed().difference(context.due).is_empty();
    0.5 * right + if clean { 0.5 } else { 0.0 }
}

/// Distance up to which a finger gets the full reward, m; as in RP1M.
pub(super) const OT_BOUND: f64 = 0.01;
/// Further distance at which it gets a tenth, m. The papers give no number. With RoboPianist's 0.1
/// a finger on the white key next to the right one gets 0.96, with 0.05 it gets
/// 0.85.
pub(super) const OT_MARGIN: f64 = 0.05;

/// Mean closeness of fingers to the due keys that lateral optimal transport assigns to them.
pub(super) fn optimal_transport(context: &StepContext) -> f64 {
    let due = context.due;
    if due.is_empty() {
        return 1.0;
    }
    let tips: [[f64; 3]; FINGERS] = std::array::from_fn(|finger| context.world.finger_pad(finger));
    let mut targets = [[0.0; 3]; KEY_COUNT];
    let mut lateral = [0.0; KEY_COUNT];
    for (slot, key) in due.iter().enumerate() {
        targets[slot] = context.world.key_target(key);
        lateral[slot] = targets[slot][1];
    }
    let count = due.len();
    let mut chosen = [None; KEY_COUNT];
    assign(&lateral[..count], &tips.map(|tip| tip[1]), &mut chosen[..count]);
    let closeness: f64 = (0..count)
        .filter_map(|slot| chosen[slot].map(|finger| distance(&tips[finger], &targets[slot])))
        .map(|distance| tolerance(distance, OT_BOUND, OT_MARGIN))
        .sum();
    closeness / count.min(FINGERS) as f64
}

/// Minus the mean distance of the finger joints from their targets at the end of the step, rad.
pub(super) fn tracking(context: &StepContext) -> f64 {
    -target_error(context, 0..RAIL) / RAIL as f64
}

/// Summed distance of these joints from their targets, rad.
pub(super) fn target_error(context: &StepContext, joints: Range<usize>) -> f64 {
    let readings = context.world.joints();
    joints.map(|joint| (context.targets[joint] - readings[joint]).abs()).sum()
}

/// 0.5 if there was no contact other than fingertips on the keyboard during the step, else 0.
pub(super) fn collision(context: &StepContext) -> f64 {
    if context.outcome.collided { 0.0 } else { 0.5 }
}
