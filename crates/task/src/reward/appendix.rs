//! The terms that the paper's appendix adds or puts in the place of others.

use etude_music::KEY_COUNT;
use etude_stage::RAIL;

use super::context::{StepContext, tolerance};

/// Closeness of the palm to the middle of the due keys along the keyboard.
pub(super) fn hand_position(context: &StepContext) -> f64 {
    if context.due.is_empty() {
        return 1.0;
    }
    let sum: f64 = context.due.iter().map(|key| context.world.key_target(key)[1]).sum();
    let middle = sum / context.due.len() as f64;
    tolerance((context.world.joints_true()[RAIL] - middle).abs(), 0.03, 0.3)
}

/// If keys are due: 0 if no key sounds; 0.5 to 1 if a key sounds that is not due, 1 to 1.5 if only
/// due keys sound, more for deeper due keys. If nothing is due: 1.5 if no key sounds, else the less
/// the deeper the deepest key is.
pub(super) fn graded_key_press(context: &StepContext) -> f64 {
    let (due, pressed) = (context.due, context.world.pressed());
    let travel = |key| context.world.key_travel(key).clamp(0.0, 1.0);
    if due.is_empty() {
        let deepest = (0..KEY_COUNT).map(travel).fold(0.0, f64::max);
        return if pressed.is_empty() { 1.5 } else { 2.0 * (1.0 - deepest) };
    }
    let mean = due.iter().map(travel).sum::<f64>() / due.len() as f64;
    match (pressed.is_empty(), pressed.difference(due).is_empty()) {
        (true, _) => 0.0,
        (false, false) => 0.5 + 0.5 * mean,
        (false, true) => 1.0 + 0.5 * mean,
    }
}

/// One minus a penalty for moving the rail while keys are down.
pub(super) fn sliding(context: &StepContext) -> f64 {
    let velocity = context.world.joint_velocities()[RAIL];
    let down = context.world.pressed();
    let neighbours = down.0 & (down.0 >> 1) != 0;
    let factor = if down.is_empty() {
        0.0
    } else if neighbours {
        2.0
    } else {
        1.0
    };
    1.0 - 3.0 * factor * velocity * velocity
}
