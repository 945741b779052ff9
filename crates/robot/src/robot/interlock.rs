//! Why the hand may not move along the keyboard as it is asked to: the arm has not followed, or a
//! finger would be dragged against the fences.

use super::rail_arm::RailArm;
use crate::allegro::{Hand, PLAYING, WIRE_JOINTS, tip_depths};
use crate::keyboard::Keyboard;
use crate::limiter::{Axis, Clamp};

/// Largest distance of the rail's set-point ahead of the arm, m: a tenth of a second at 0.6 m/s.
/// Playing on the twin reaches 38 mm. The torque clamp does the same for the fingers: policies
/// press by asking for up to 1.6 rad more than a key allows.
const MAX_AHEAD_M: f64 = 0.06;
/// The same ahead of the arm's target while a finger is down, m: the arm may then not hurry after
/// it.
const MAX_AHEAD_OF_TARGET_M: f64 = 0.02;
/// Height of the fingers' roots over the tops of the white keys when the arm is on its path, m
/// (lasr-lab/learning-to-play-piano; the keys are 22.5 mm high there).
pub const ROOTS_OVER_KEYS_M: f64 = 0.12 - 0.0225;
/// A fingertip that is so far below the tops of the white keys is between two fences, m. Their tops
/// are at 2 mm; a white key sounds at 3 mm where it is played.
const BETWEEN_FENCES_M: f64 = 0.003;
/// A fingertip that is no higher over the tops of the white keys may press a black one, m: their
/// tops are 12.5 mm over them.
const OVER_BLACK_M: f64 = 0.013;

/// Holds the rail back while a finger is down.
#[derive(Clone, Copy)]
pub(super) struct Interlock {
    finger_is_down: bool,
    max_velocity: f64,
}

impl Interlock {
    /// `max_velocity` is that of the rail while a finger is down. A finger is down if a key sounds,
    /// or a fingertip is as low as between two fences: a keyboard that is silent does not show the
    /// latter.
    pub fn new(hand: &Hand, keyboard: &Keyboard, max_velocity: f64) -> Self {
        let is_low = |depth: f64| depth > ROOTS_OVER_KEYS_M + BETWEEN_FENCES_M;
        let finger_is_down = keyboard.pressed() != 0 || tip_depths(&hand.positions()).into_iter().any(is_low);
        Self { finger_is_down, max_velocity }
    }

    /// Why the rail's set-point brakes now, whatever is asked.
    pub fn holds_rail(self, axis: &Axis, arm: &RailArm) -> Option<Clamp> {
        if !arm.is_on_path() {
            return None;
        }
        let ahead_of = |rail_m: f64| (axis.position() - rail_m) * axis.velocity().signum();
        if ahead_of(arm.place().rail_m) > MAX_AHEAD_M {
            return Some(Clamp::Ahead);
        }
        let waits = self.finger_is_down && ahead_of(arm.axis().position()) > MAX_AHEAD_OF_TARGET_M;
        (waits || self.drags(axis)).then_some(Clamp::KeyDown)
    }

    /// Whether a finger between two fences would be dragged along the keyboard too fast.
    pub fn drags(self, rail: &Axis) -> bool {
        self.finger_is_down && rail.velocity().abs() > self.max_velocity
    }
}

/// Which fingertips may press a key: friction and fences then hold the finger's rotation at the
/// palm on both sides.
pub(super) fn may_press(positions: &[f64; WIRE_JOINTS], is_on_path: bool) -> [bool; PLAYING] {
    tip_depths(positions).map(|depth| is_on_path && depth > ROOTS_OVER_KEYS_M - OVER_BLACK_M)
}
