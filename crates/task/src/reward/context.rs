//! What the reward's terms are computed from, and the functions that they share.

use etude_music::KeySet;
use etude_stage::{DRIVEN_JOINTS, StepOutcome, World};

use crate::ACTION_LEN;
use crate::fingering::Goals;

/// The world after a control step, the action and the due keys.
pub struct StepContext<'a> {
    /// The world after the step.
    pub world: &'a World,
    /// Keys that were due in the step.
    pub due: KeySet,
    /// Those of them to hold: a fingering shortens some notes, to be on time at the next ones.
    pub to_hold: KeySet,
    /// Keys that sounded before the step.
    pub pressed_before: KeySet,
    /// Power and collisions of the step.
    pub outcome: StepOutcome,
    /// The joints' targets in the step: encoder readings, rad, the rail in m.
    pub targets: &'a [f64; DRIVEN_JOINTS],
    /// The action of the step.
    pub action: &'a [f32; ACTION_LEN],
    /// The action of the previous step; in the first step, the one whose targets are the starting
    /// pose, as far as the range allows.
    pub previous_action: &'a [f32; ACTION_LEN],
    /// The goals of the fingers in the step; none without a fingering.
    pub goals: Goals,
}

/// Gaussian tolerance as in dm_control's `rewards.tolerance`: 1 up to `bound`, falling to 0.1 at
/// `bound + margin`.
pub fn tolerance(value: f64, bound: f64, margin: f64) -> f64 {
    if value <= bound {
        return 1.0;
    }
    let scaled = (value - bound) / margin;
    // exp(−½ s²) with s chosen so that it is a tenth at one margin.
    0.1f64.powf(scaled * scaled)
}

pub(super) fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerance_is_dm_controls() {
        let expected = [(0.05, 1.0), (0.10, 0.977), (0.25, 0.692), (0.50, 0.155), (0.75, 0.011)];
        for (value, want) in expected {
            assert!((tolerance(value, 0.05, 0.5) - want).abs() < 1e-3, "{value}");
        }
    }
}
