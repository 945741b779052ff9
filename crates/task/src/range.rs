//! The mapping from actions to joint targets.

use std::sync::Arc;

use etude_stage::geometry::{HALF_WIDTH, WHITE_PITCH, key_lateral};
use etude_stage::hand::ROOT_SPACING;
use etude_stage::{DRIVEN_JOINTS, RAIL, joint_range};

use crate::{ACTION_LEN, Fingering, Piece};

/// Range of each joint's target, to which an action in [−1, 1] is mapped: the joint's own range for
/// a finger joint, the part of the keyboard that the piece needs for the rail. With a fingering,
/// the rail's range is [`TaskConfig::rail_range`](crate::TaskConfig::rail_range) to either side of
/// its planned position, and with [`TaskConfig::finger_range`](crate::TaskConfig::finger_range)
/// those of the finger joints are around the planned pose.
///
/// If the rail's range were the whole keyboard, a change of its action by 0.02 would be 7 mm, more
/// than a fingertip may be off the middle of a key between fences.
#[derive(Clone, Debug, PartialEq)]
pub struct TargetRange {
    ranges: [[f64; 2]; DRIVEN_JOINTS],
    fingering: Option<Arc<Fingering>>,
}

impl TargetRange {
    /// The range for `piece`. Without a fingering, the rail can bring any finger over any of its
    /// keys, and one white key further.
    pub fn new(piece: &Piece) -> Self {
        let mut ranges = std::array::from_fn(joint_range);
        let fingering = piece.fingering().cloned();
        if let Some(fingering) = &fingering {
            ranges[RAIL] = [-fingering.rail_range(), fingering.rail_range()];
            if let Some(poses) = fingering.poses() {
                ranges[..RAIL].fill([-poses.range, poses.range]);
            }
        } else if let Some(range) = over_its_keys(piece) {
            ranges[RAIL] = range;
        }
        Self { ranges, fingering }
    }

    /// Lowest and highest target of `joint`, rad or m; with a fingering, relative to what it plans.
    pub fn span(&self, joint: usize) -> [f64; 2] {
        self.ranges[joint]
    }

    /// Lowest and highest target of `joint` in control step `step`, rad or m.
    pub fn ends(&self, joint: usize, step: usize) -> [f64; 2] {
        let planned = self.fingering.as_ref().map_or(0.0, |fingering| match joint {
            RAIL => fingering.rail_at(step),
            finger => fingering.poses().map_or(0.0, |poses| poses.at(step)[finger]),
        });
        self.ranges[joint].map(|end| planned + end)
    }

    /// Joint targets (rad, the rail in m) of an action in control step `step`; its values are
    /// clamped to ±1.
    pub fn targets(&self, action: &[f32; ACTION_LEN], step: usize) -> [f64; DRIVEN_JOINTS] {
        std::array::from_fn(|joint| {
            let [low, high] = self.ends(joint, step);
            low + (f64::from(action[joint].clamp(-1.0, 1.0)) + 1.0) / 2.0 * (high - low)
        })
    }

    /// The action with these [`targets`](Self::targets); targets beyond a range give ±1.
    pub fn action(&self, targets: &[f64; DRIVEN_JOINTS], step: usize) -> [f32; ACTION_LEN] {
        std::array::from_fn(|joint| {
            let [low, high] = self.ends(joint, step);
            (((targets[joint] - low) / (high - low) * 2.0 - 1.0).clamp(-1.0, 1.0)) as f32
        })
    }
}

/// Positions of the rail from which any finger is over any key of the piece, and one white key
/// further, m; none without keys.
fn over_its_keys(piece: &Piece) -> Option<[f64; 2]> {
    let keys = || piece.frames().iter().flat_map(|due| due.iter()).map(key_lateral);
    let (lowest, highest) = (keys().reduce(f64::min)?, keys().reduce(f64::max)?);
    let beyond = ROOT_SPACING + WHITE_PITCH;
    Some([(lowest - beyond).max(-HALF_WIDTH), (highest + beyond).min(HALF_WIDTH)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_music::repertoire;

    fn scale() -> TargetRange {
        TargetRange::new(&Piece::new(&repertoire::get("c-major-scale").expect("built in"), 1.0).unwrap())
    }

    #[test]
    fn action_undoes_targets() {
        let range = scale();
        let action: [f32; ACTION_LEN] = std::array::from_fn(|j| j as f32 / 6.0 - 1.0);
        let back = range.action(&range.targets(&action, 0), 0);
        assert!(action.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-6));
        assert_eq!(range.targets(&[9.0; ACTION_LEN], 0), range.targets(&[1.0; ACTION_LEN], 0));
    }

    #[test]
    fn the_rail_brings_every_finger_over_every_key_of_the_piece() {
        let range = scale();
        let [low, high] = range.ends(RAIL, 0);
        // From middle C (key 24) to the C above.
        assert!(low < key_lateral(24) - ROOT_SPACING && high > key_lateral(36) + ROOT_SPACING);
        assert!(high - low < 0.3);
    }
}
