//! What the sequences share.

use etude_music::CONTROL_HZ;
use etude_stage::hand::{FINGERS, JOINTS_PER_FINGER};
use etude_stage::{DRIVEN_JOINTS, RAIL};

/// Length of a control step, s.
pub(super) const STEP_SECS: f64 = 1.0 / CONTROL_HZ;
/// Fingers almost straight: every sequence begins and ends here.
pub(super) const REST: [f64; JOINTS_PER_FINGER] = [0.0, 0.05, 0.15, 0.15];

pub(super) fn pose(fingers: &[[f64; JOINTS_PER_FINGER]; FINGERS], rail: f64) -> [f64; DRIVEN_JOINTS] {
    std::array::from_fn(|joint| match joint {
        RAIL => rail,
        _ => fingers[joint / JOINTS_PER_FINGER][joint % JOINTS_PER_FINGER],
    })
}

pub(super) fn steps(secs: f64) -> usize {
    (secs * CONTROL_HZ).round() as usize
}

pub(super) fn blend(
    from: &[f64; JOINTS_PER_FINGER],
    to: &[f64; JOINTS_PER_FINGER],
    share: f64,
) -> [f64; JOINTS_PER_FINGER] {
    std::array::from_fn(|joint| from[joint] + share * (to[joint] - from[joint]))
}
