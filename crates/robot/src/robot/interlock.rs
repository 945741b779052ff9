//! Why the hand may not move along the keyboard as it is asked to: the arm has not followed, or a finger would be dragged against the fences.

use super::Robot;
use super::axes::RAIL_AXIS;
use crate::allegro::{JOINTS, PLAYING, tip_depths};
use crate::limiter::{Axis, Clamp};

/// Largest lead of the rail's set-point over the arm, m: a tenth of a second at 0.6 m/s. Playing on the twin reaches 38 mm. The torque
/// clamp does the same for the fingers: policies press by asking for up to 1.6 rad more than a key allows.
const AHEAD_M: f64 = 0.06;
/// Largest lead of the rail's set-point over the arm's target while a finger is down, m: the arm may then not hurry after it.
const BEFORE_TARGET_M: f64 = 0.02;
/// Height of the fingers' roots over the tops of the white keys when the arm is on its path, m (lasr-lab/learning-to-play-piano; the
/// keys are 22.5 mm high there).
pub const ROOTS_OVER_KEYS_M: f64 = 0.12 - 0.0225;
/// A fingertip that is so far below the tops of the white keys is between two fences, m. Their tops are at 2 mm; a white key sounds at 3 mm
/// where it is played.
const BETWEEN_FENCES_M: f64 = 0.003;
/// A fingertip that is no higher over the tops of the white keys may press a black one, m: their tops are 12.5 mm over them.
const OVER_BLACK_M: f64 = 0.013;

impl Robot {
    /// Why the rail's set-point brakes now, whatever is asked.
    pub(super) fn holds_rail(&self) -> Option<Clamp> {
        self.arm_sent?;
        let axis = &self.axes[RAIL_AXIS];
        let before = |rail_m: f64| (axis.position() - rail_m) * axis.velocity().signum();
        if before(self.place().rail_m) > AHEAD_M {
            return Some(Clamp::Ahead);
        }
        let waits = self.finger_is_down() && before(self.arm_axis.position()) > BEFORE_TARGET_M;
        (waits || self.drags(axis)).then_some(Clamp::KeyDown)
    }

    /// Whether a finger between two fences would be dragged along the keyboard too fast.
    pub(super) fn drags(&self, rail: &Axis) -> bool {
        rail.velocity().abs() > self.config.limits.key_down_rail_velocity && self.finger_is_down()
    }

    /// Which fingertips may press a key: friction and fences then hold the finger's rotation at the palm on both sides.
    pub(super) fn may_press(&self, positions: &[f64; JOINTS]) -> [bool; PLAYING] {
        let at_the_keys = self.arm_sent.is_some();
        tip_depths(positions).map(|depth| at_the_keys && depth > ROOTS_OVER_KEYS_M - OVER_BLACK_M)
    }

    /// Whether a key sounds, or a fingertip is as low as between two fences: a keyboard that is silent does not show the latter.
    fn finger_is_down(&self) -> bool {
        let low = |depth: f64| depth > ROOTS_OVER_KEYS_M + BETWEEN_FENCES_M;
        self.keyboard.pressed() != 0 || tip_depths(&self.hand.positions()).into_iter().any(low)
    }
}
