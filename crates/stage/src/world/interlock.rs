//! The rig's interlock, in the simulator: the rail brakes where the hand has not followed it, or
//! would drag a finger that is among the keys to the stop of its roll joint. A policy that never
//! met it drags its fingers, and a rig then holds it.
//!
//! `crates/robot/src/robot/interlock.rs` says why for each number; tests of that crate compare the
//! two.

use super::World;
use crate::controller::Actuation;
use crate::geometry::WHITE;
use crate::hand::{DRIVEN_JOINTS, FINGERS, JOINTS_PER_FINGER, MOUNT, RAIL, Side, TIP_RADIUS, joint_range};
use crate::kinematics::fingertip;

/// Largest distance of the rail's reference ahead of the hand, m.
pub const MAX_AHEAD_M: f64 = 0.06;
/// A fingertip that is so far below the tops of the resting white keys is among them, m.
const AMONG_KEYS_M: f64 = 0.0015;
/// A finger among the keys whose roll joint is so far from its reference is dragged along, rad.
const MAX_BEHIND_RAD: f64 = 0.1;
/// A dragged finger stays so far from the stop of its roll joint, rad.
const BEFORE_STOP_RAD: f64 = 0.05;

/// How far the hand may move on toward the low and toward the high notes, m, at these readings and
/// references of the joints. Infinite where no finger is dragged that way.
pub fn drag_ways_m(
    side: Side,
    readings: &[f64; DRIVEN_JOINTS],
    references: &[f64; DRIVEN_JOINTS],
) -> [f64; 2] {
    let mut ways_m = [f64::INFINITY; 2];
    for finger in 0..FINGERS {
        let joint = JOINTS_PER_FINGER * finger;
        let angles = std::array::from_fn(|index| readings[joint + index]);
        let height = fingertip(side, finger, &angles, 0.0)[2];
        if height - TIP_RADIUS >= WHITE.top() - AMONG_KEYS_M {
            continue;
        }
        // The tip lags behind a hand that moves toward the high notes if its roll grows.
        let (roll, behind_rad) = (angles[0], angles[0] - references[joint]);
        let [low, high] = joint_range(joint);
        let way_m = |stop: f64| (MOUNT[1] - height) * (stop.tan() - roll.tan());
        if behind_rad < -MAX_BEHIND_RAD {
            ways_m[0] = ways_m[0].min(-way_m(low + BEFORE_STOP_RAD));
        }
        if behind_rad > MAX_BEHIND_RAD {
            ways_m[1] = ways_m[1].min(way_m(high - BEFORE_STOP_RAD));
        }
    }
    ways_m
}

impl World {
    /// Whether the rail's reference brakes now instead of moving on toward `target`.
    pub(super) fn holds_rail(&self, target: f64) -> bool {
        if self.config.actuation != Actuation::Controlled {
            return false;
        }
        let readings = self.joints();
        let (rail, constants, at) = (&self.controllers[RAIL], &self.constants[RAIL], readings[RAIL]);
        if (rail.reference() - at) * rail.velocity().signum() > MAX_AHEAD_M {
            return true;
        }
        let ways_m = drag_ways_m(self.config.side, &readings, &self.references());
        let [moves_m, stop] = rail.next_stop(constants, target);
        (stop - at) * moves_m.signum() > ways_m[usize::from(moves_m > 0.0)]
    }
}
