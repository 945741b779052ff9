//! Why the hand may not move along the keyboard as it is asked to: the arm has not followed, or a
//! finger among the keys would be dragged along.
//!
//! A pressed key lies between the bodies of its neighbours. A hand that moves on drags the
//! fingertip against them, and then the finger turns back about its roll joint, the first of its
//! four. Up to that joint's stop the key bears what the joint's torque clamp allows, some 3 N; at
//! the stop it bears the arm.

use std::time::Duration;

use super::rail_arm::RailArm;
use crate::allegro::{Hand, JOINT_LIMITS_RAD, PLAYING, TIP_RADIUS_M, WIRE_JOINTS, tip_depths};
use crate::limiter::{Axis, Clamp};

/// Largest distance of the rail's set-point ahead of the arm, m: a tenth of a second at 0.6 m/s.
/// Playing on the twin reaches 38 mm. The torque clamp does the same for the fingers: policies
/// press by asking for up to 1.6 rad more than a key allows.
pub const MAX_AHEAD_M: f64 = 0.06;
/// Height of the fingers' roots over the tops of the white keys when the arm is on its path, m
/// (lasr-lab/learning-to-play-piano; the keys are 22.5 mm high there).
pub const ROOTS_OVER_KEYS_M: f64 = 0.12 - 0.0225;
/// A fingertip that is so far below the tops of the resting white keys may be among them, m: half
/// of where a white key sounds, since the encoders' biases and play are 2 mm at the fingertip.
const AMONG_KEYS_M: f64 = 0.0015;
/// A finger among the keys whose roll joint is so far from its reference is dragged along, rad: the
/// joint loop then pushes with all that its clamp allows (375 of 3600 PWM a rad), and the stop is
/// 0.47 rad from the middle.
const MAX_BEHIND_RAD: f64 = 0.1;
/// A dragged finger stays so far from the stop of its roll joint, rad: our choice, 4 mm at the
/// fingertip, for biases of the encoder (1°) and what the arm moves on until a reading arrives.
const BEFORE_STOP_RAD: f64 = 0.05;
/// A fingertip that is no higher over the tops of the white keys may press a black one, m: their
/// tops are 12.5 mm over them.
const OVER_BLACK_M: f64 = 0.013;

/// Holds the rail back while a finger is dragged along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Interlock {
    /// How far the hand may move on toward the low and toward the high notes, m: a finger that it
    /// drags that way stays where it is.
    ways_m: [f64; 2],
    /// How old the angles are from which they follow, s: the hand has moved on since.
    age_secs: f64,
}

impl Interlock {
    pub fn new(hand: &Hand, reference: &[f64; WIRE_JOINTS], now: Duration) -> Self {
        let age = hand.positions_at().map_or(Duration::ZERO, |at| now.saturating_sub(at));
        Self { ways_m: drag_ways_m(&hand.positions(), reference), age_secs: age.as_secs_f64() }
    }

    /// Why the rail's set-point brakes now instead of moving toward `asked_m`.
    pub fn holds_rail(self, axis: &Axis, asked_m: f64, arm: &RailArm) -> Option<Clamp> {
        if !arm.is_on_path() {
            return None;
        }
        let at_m = arm.place().rail_m;
        if (axis.position() - at_m) * axis.velocity().signum() > MAX_AHEAD_M {
            return Some(Clamp::Ahead);
        }
        self.drags(axis, asked_m, at_m).then_some(Clamp::Dragging)
    }

    /// Whether the hand, which is at `at_m`, would drag a finger as far as its stop if the rail did
    /// not brake now.
    pub fn drags(self, axis: &Axis, asked_m: f64, at_m: f64) -> bool {
        if self.ways_m == [f64::INFINITY; 2] {
            return false;
        }
        let mut next = axis.clone();
        next.step(asked_m);
        let moves_m = next.position() - axis.position();
        let was_at_m = at_m - axis.velocity() * self.age_secs;
        (next.stop_position() - was_at_m) * moves_m.signum() > self.ways_m[usize::from(moves_m > 0.0)]
    }
}

/// How far the hand may move on toward the low and toward the high notes, m, at these readings and
/// references of the hand's joints. Infinite where no finger is dragged that way.
pub fn drag_ways_m(positions: &[f64; WIRE_JOINTS], reference: &[f64; WIRE_JOINTS]) -> [f64; 2] {
    let mut ways_m = [f64::INFINITY; 2];
    for (finger, depth_m) in tip_depths(positions).into_iter().enumerate() {
        if depth_m <= ROOTS_OVER_KEYS_M + AMONG_KEYS_M {
            continue;
        }
        // The tip lags behind a hand that moves toward the high notes if its roll grows.
        let (roll, [low, high]) = (positions[4 * finger], JOINT_LIMITS_RAD[4 * finger]);
        let behind_rad = roll - reference[4 * finger];
        let way_m = |stop: f64| (depth_m - TIP_RADIUS_M) * (stop.tan() - roll.tan());
        if behind_rad < -MAX_BEHIND_RAD {
            ways_m[0] = ways_m[0].min(-way_m(low + BEFORE_STOP_RAD));
        }
        if behind_rad > MAX_BEHIND_RAD {
            ways_m[1] = ways_m[1].min(way_m(high - BEFORE_STOP_RAD));
        }
    }
    ways_m
}

/// Which fingertips may press a key: friction and the neighbouring keys then hold the finger's
/// rotation at the palm on both sides.
pub(super) fn may_press(positions: &[f64; WIRE_JOINTS], is_on_path: bool) -> [bool; PLAYING] {
    tip_depths(positions).map(|depth| is_on_path && depth > ROOTS_OVER_KEYS_M - OVER_BLACK_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limiter::AxisLimits;

    /// Angles at which the middle finger hangs down to this depth below the roots, m.
    fn hanging(roll: f64, below_tops_m: f64) -> [f64; WIRE_JOINTS] {
        let mut positions = [0.0; WIRE_JOINTS];
        positions[4] = roll;
        positions[5] = (0..1600)
            .map(|step| f64::from(step) * 1e-3)
            .find(|bend| {
                positions[5] = *bend;
                tip_depths(&positions)[1] > ROOTS_OVER_KEYS_M + below_tops_m
            })
            .unwrap();
        positions
    }

    #[test]
    fn a_dragged_finger_leaves_the_way_to_the_stop_of_its_roll_joint() {
        let ways = |roll: f64, sent: f64, below_tops_m: f64| {
            let (positions, mut reference) = (hanging(roll, below_tops_m), [0.0; WIRE_JOINTS]);
            reference[4] = sent;
            drag_ways_m(&positions, &reference)
        };
        // It is above the keys, and it is where it was sent.
        assert_eq!(ways(0.2, 0.0, 0.001), [f64::INFINITY; 2]);
        assert_eq!(ways(0.2, 0.15, 0.004), [f64::INFINITY; 2]);
        // A tip that has stayed behind a hand on its way to the high notes, and one to the low
        // ones.
        let [low, high] = ways(0.2, 0.0, 0.004);
        assert!(low == f64::INFINITY && (0.021..0.025).contains(&high), "{low} and {high} m");
        assert_eq!(ways(-0.2, 0.0, 0.004), [high, low]);
        assert!(ways(0.45, 0.3, 0.004)[1] < 0.0);
    }

    #[test]
    fn the_rail_brakes_where_it_can_still_stop_and_may_go_back() {
        let limits = AxisLimits { position: [-0.3, 0.3], velocity: 0.8, acceleration: 7.5, jerk: 1500.0 };
        let mut axis = Axis::at_rest(limits, 0.005, 0.0);
        let interlock = Interlock { ways_m: [f64::INFINITY, 0.04], age_secs: 0.0 };
        let begun = axis.position();
        for _ in 0..200 {
            if interlock.drags(&axis, 0.3, begun) {
                axis.brake();
            } else {
                axis.step(0.3);
            }
        }
        assert!((0.039..0.041).contains(&axis.position()), "{} m", axis.position());
        assert!(!interlock.drags(&axis, -0.1, 0.0));
        let at_stop = Interlock { ways_m: [0.1, -0.01], age_secs: 0.0 };
        assert!(at_stop.drags(&Axis::at_rest(limits, 0.005, 0.0), 0.1, 0.0));
    }

    /// A hand that sends no more angles: the way that is left shrinks while it moves on.
    #[test]
    fn old_angles_leave_less_way() {
        let limits = AxisLimits { position: [-0.3, 0.3], velocity: 0.8, acceleration: 7.5, jerk: 1500.0 };
        let mut axis = Axis::at_rest(limits, 0.005, 0.0);
        (0..20).for_each(|_| _ = axis.step(0.3));
        let stop_m = axis.stop_position() - axis.position();
        let drags = |age_secs: f64| {
            let interlock = Interlock { ways_m: [f64::INFINITY, stop_m + 0.02], age_secs };
            interlock.drags(&axis, 0.3, axis.position())
        };
        assert!(!drags(0.0) && drags(0.03), "{} m/s", axis.velocity());
    }
}
