//! Joints of the hand that are pushed both ways and do not turn: the encoder or the motor has
//! failed, or something blocks the joint.
//!
//! A key or a stop holds a joint in one direction only; but a finger that presses a key is held by
//! friction and by the neighbouring keys in its rotation at the palm, on both sides, and that is
//! not watched then.
//! The thresholds are judgements: playing the shipped songs on the twin (`ideal`, `standard` and
//! `worn`, real execution), no joint stood for more than 0.054 s on either side. That a joint turns
//! against its torque says nothing while it plays: keys push it by up to 1.6 rad.

use std::time::Duration;

use crate::allegro::{PLAYING, WIRE_JOINTS};

/// How far the reading of a joint that stands may wander, rad.
const STANDS_RAD: f64 = 0.01;
/// How far a joint must be from its reference, on either side, rad: a torque that moves a sound
/// joint.
const PUSHED_RAD: f64 = 0.07;
/// How long on either side, s.
const PUSHED_SECS: f64 = 0.15;

/// Where a joint stands, and how long its reference was above and below that, s.
#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    stands_at: f64,
    pushed_secs: [f64; 2],
}

/// Watches whether the joints of the hand turn as they are pushed.
#[derive(Clone, Debug, Default)]
pub(super) struct StuckJoints {
    joints: [Joint; WIRE_JOINTS],
    at: Option<Duration>,
}

impl StuckJoints {
    /// Takes a period's angles, where the joints were sent (rad), and which fingers may press a
    /// key. The first joint that stands although it was pushed both ways, if any, and where, rad.
    pub fn take(
        &mut self,
        at: Duration,
        positions: &[f64; WIRE_JOINTS],
        reference: &[f64; WIRE_JOINTS],
        may_press: [bool; PLAYING],
    ) -> Option<(usize, f64)> {
        let secs = at.saturating_sub(self.at.unwrap_or(at)).as_secs_f64();
        self.at = Some(at);
        let mut found = None;
        let pairs = positions.iter().zip(reference);
        for (joint, (state, (&rad, &reference))) in self.joints.iter_mut().zip(pairs).enumerate() {
            let is_held = joint.is_multiple_of(4) && may_press.get(joint / 4) == Some(&true);
            if is_held {
                *state = Joint { stands_at: rad, pushed_secs: [0.0; 2] };
            } else if state.stands(secs, rad, reference) {
                found = found.or(Some((joint, rad)));
            }
        }
        found
    }
}

impl Joint {
    fn stands(&mut self, secs: f64, position: f64, reference: f64) -> bool {
        if (position - self.stands_at).abs() > STANDS_RAD {
            *self = Self { stands_at: position, pushed_secs: [0.0; 2] };
        }
        let by_rad = reference - position;
        if by_rad.abs() > PUSHED_RAD {
            self.pushed_secs[usize::from(by_rad < 0.0)] += secs;
        }
        self.pushed_secs.iter().all(|secs| *secs > PUSHED_SECS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(3);

    /// The stuck joint after a second in which joint 6 is at `what(s)`: position and reference.
    fn after_a_second(what: impl Fn(f64) -> (f64, f64)) -> Option<(usize, f64)> {
        after_a_second_of(6, [false; PLAYING], what)
    }

    fn after_a_second_of(
        joint: usize,
        may_press: [bool; PLAYING],
        what: impl Fn(f64) -> (f64, f64),
    ) -> Option<(usize, f64)> {
        let mut stuck = StuckJoints::default();
        let mut found = None;
        for period in 0..333 {
            let at = PERIOD * period;
            let (mut positions, mut reference) = ([0.0; WIRE_JOINTS], [0.0; WIRE_JOINTS]);
            (positions[joint], reference[joint]) = what(at.as_secs_f64());
            found = found.or(stuck.take(at, &positions, &reference, may_press));
        }
        found
    }

    #[test]
    fn a_joint_that_is_pushed_both_ways_turns_or_is_stuck() {
        let wave = |secs: f64| 0.1 * (12.0 * secs).sin();
        let stands = after_a_second(|secs| (0.004, wave(secs)));
        assert_eq!(stands, Some((6, 0.004)));
        assert_eq!(after_a_second(|secs| (wave(secs - 0.05), wave(secs))), None, "late");
        assert_eq!(after_a_second(|secs| (0.0, wave(secs).abs())), None, "held by a key");
        assert_eq!(after_a_second(|secs| (0.0, 0.6 * wave(secs))), None, "by little");
    }

    #[test]
    fn a_finger_that_presses_a_key_may_stand_in_its_rotation_only() {
        let pushed = |secs: f64| (0.05, 0.05 + 0.1 * (12.0 * secs).sin());
        let ring = [false, false, true];
        assert_eq!(after_a_second_of(8, ring, pushed), None);
        assert_eq!(after_a_second_of(8, [true, true, false], pushed), Some((8, 0.05)));
        assert_eq!(after_a_second_of(9, ring, pushed), Some((9, 0.05)));
        assert_eq!(after_a_second_of(12, [true; PLAYING], pushed), Some((12, 0.05)));
    }
}
