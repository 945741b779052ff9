//! Poses that hold the fingertips over their goals.

use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::JointRow;
use etude_stage::{FINGERS, PhysicalParams};

use super::goal::Goals;
use super::hand_reach::HandReach;

/// Joint angles of all fingers, as the encoders read them, rad.
pub type FingerAngles = [f64; FINGERS * JOINTS_PER_FINGER];

/// In each control step, the pose around which the targets of the fingers are.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses {
    /// How far a target may be from it, rad.
    pub range: f64,
    angles: Vec<FingerAngles>,
}

impl Poses {
    /// The pose in control step `step`; after the end, that of the last.
    pub fn at(&self, step: usize) -> &FingerAngles {
        self.angles.get(step).or(self.angles.last()).unwrap_or(&[0.0; FINGERS * JOINTS_PER_FINGER])
    }

    /// The poses for these goals, with the rail at `rail` at the end of each control step. A finger
    /// without a goal keeps its pose; before its first one it waits over the white keys.
    pub(super) fn over_goals(
        reach: &HandReach,
        params: &PhysicalParams,
        goals: &[Goals],
        rail: &[f64],
        range: f64,
    ) -> Self {
        let mut pose = FingerAngles::default();
        let mut hold = |finger: usize, [x, y]: [f64; 2], height: f64, rail: f64| {
            if let Some(angles) = reach.joint_angles(finger, [x, y, height], rail) {
                for (joint, angle) in (finger * JOINTS_PER_FINGER..).zip(angles) {
                    pose[joint] = angle + params.joint(JointRow::EncoderBias, joint);
                }
            }
            pose
        };
        let [front, _] = reach.over(0);
        let start = rail.first().copied().unwrap_or_default();
        let mut last = FingerAngles::default();
        for finger in 0..FINGERS {
            let idle = [front, reach.unturned(finger, front) + start];
            last = hold(finger, idle, reach.hover_height(0), start);
        }
        let angles = goals.iter().zip(rail).map(|(goals, rail)| {
            for (finger, goal) in goals.iter().enumerate() {
                if let Some(goal) = goal {
                    last = hold(finger, goal.over, reach.hover_height(goal.key), *rail);
                }
            }
            last
        });
        Self { range, angles: angles.collect() }
    }
}
