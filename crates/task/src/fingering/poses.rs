//! Poses that hold the fingertips over their goals.

use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::JointRow;
use etude_stage::{FINGERS, PhysicalParams};

use super::Goals;
use super::comb::Comb;

/// Joint angles of all fingers, as the encoders read them, rad.
pub type Fingers = [f64; FINGERS * JOINTS_PER_FINGER];

/// In each control step, the pose around which the targets of the fingers are.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses {
    /// How far a target may be from it, rad.
    pub range: f64,
    pub(super) angles: Vec<Fingers>,
}

impl Poses {
    /// The pose in control step `step`; after the end, that of the last.
    pub fn at(&self, step: usize) -> &Fingers {
        self.angles.get(step).or(self.angles.last()).unwrap_or(&[0.0; FINGERS * JOINTS_PER_FINGER])
    }
}

/// The pose in each control step, with the rail at these places at its end. A finger without a goal keeps its pose; before its first one it waits
/// over the white keys.
pub(super) fn over_goals(
    comb: &Comb,
    params: &PhysicalParams,
    goals: &[Goals],
    rail: &[f64],
) -> Vec<Fingers> {
    let mut pose = Fingers::default();
    let mut hold = |finger: usize, over: [f64; 2], height: f64, rail: f64| {
        let [x, y] = over;
        if let Some(angles) = comb.angles(finger, [x, y, height], rail) {
            for (joint, angle) in angles.into_iter().enumerate() {
                let joint = finger * JOINTS_PER_FINGER + joint;
                pose[joint] = angle + params.joint(JointRow::EncoderBias, joint);
            }
        }
        pose
    };
    let [front, _] = comb.over(0);
    let start = rail.first().copied().unwrap_or_default();
    let idle = |finger: usize| [front, comb.unturned(finger, front) + start];
    let mut last = Fingers::default();
    for finger in 0..FINGERS {
        last = hold(finger, idle(finger), comb.hover(0), start);
    }
    let steps = goals.iter().zip(rail);
    steps
        .map(|(goals, rail)| {
            for (finger, goal) in goals.iter().enumerate() {
                if let Some(goal) = goal {
                    last = hold(finger, goal.over, comb.hover(goal.key), *rail);
                }
            }
            last
        })
        .collect()
}
