//! Joints of the hand that run away from where they are pushed: the encoder or the motor counts in
//! the wrong direction.
//!
//! Such a joint obeys nobody. It leaves its reference faster and faster, under a torque toward it,
//! runs to a stop and is pushed against that with all its torque. A key, a fence or a person can
//! push a finger away too; but a key bends a finger only upward, and nobody pushes one to where a
//! joint of the wrong sign ends: a reading that mirrors one of its stops, or lies beyond the other.

use std::time::Duration;

use super::plausibility::Implausible;
use crate::allegro::{JOINT_LIMITS_RAD, PLAYING, WIRE_JOINTS};

/// Share of its limit with which a joint is pushed, at least, if that is to move it.
const PUSHED_SHARE: f64 = 0.3;
/// How fast and how far a joint runs away, rad/s and rad.
const RUNS_RAD_S: f64 = 0.8;
const RAN_RAD: f64 = 0.05;
/// A rotation at the palm that runs as fast may end anywhere: at a fence, or at another finger.
const RUNS_FAST_RAD_S: f64 = 2.0;
/// How long it is then pushed hard and stands, share, s and rad.
const HARD_SHARE: f64 = 0.7;
const HARD_SECS: f64 = 0.3;
const STANDS_RAD: f64 = 0.03;
/// How near a stop a joint is that stands at it, and how far a stop may be outside the range, rad.
const NEAR_STOP_RAD: f64 = 0.05;
const STOP_OUTSIDE_RAD: f64 = 0.2;
/// How far outside its range no joint can be that is pushed back, rad.
const BEYOND_RAD: f64 = 0.1;
/// A longer time between two readings says nothing, s.
const MAX_SECS: f64 = 0.05;

#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    before: f64,
    /// How far it ran away, and how far fast, less what it came back as it was pushed, rad.
    ran_rad: f64,
    ran_fast_rad: f64,
    stands_at: f64,
    /// How long it has been pushed hard there: with the sign of the push.
    hard_secs: f64,
}

/// Watches whether the joints of the hand turn as they are pushed.
#[derive(Clone, Debug, Default)]
pub(super) struct Runaways {
    joints: [Joint; WIRE_JOINTS],
    at: Option<Duration>,
}

impl Runaways {
    /// Takes a period's angles, where the joints were sent (rad), their torques as shares of their
    /// limits, and which fingers may press a key. The first joint that ran away, if any.
    pub fn take(
        &mut self,
        at: Duration,
        positions: &[f64; WIRE_JOINTS],
        reference: &[f64; WIRE_JOINTS],
        shares: &[f64; WIRE_JOINTS],
        may_press: [bool; PLAYING],
    ) -> Option<Implausible> {
        let secs = at.saturating_sub(self.at.replace(at).unwrap_or(at)).as_secs_f64();
        let mut found = None;
        for (joint, state) in self.joints.iter_mut().enumerate() {
            let (rad, share) = (positions[joint], shares[joint]);
            let rotates = joint.is_multiple_of(4) && joint / 4 < PLAYING;
            state.push(secs, rad, reference[joint], share);
            let in_fences = rotates && may_press.get(joint / 4) == Some(&true);
            let ran = if rotates && state.ran_fast_rad > RAN_RAD {
                !in_fences
            } else {
                state.ran_rad > RAN_RAD && ends_there(joint, rad, share)
            };
            if ran && state.hard_secs > HARD_SECS {
                found = found.or(Some(Implausible::JointRunsAway { joint, rad }));
            }
        }
        found
    }
}

impl Joint {
    fn push(&mut self, secs: f64, rad: f64, reference: f64, share: f64) {
        let moved = rad - std::mem::replace(&mut self.before, rad);
        let toward = (reference - rad) * share > 0.0;
        if secs <= 0.0 || secs > MAX_SECS || !toward {
            (self.stands_at, self.hard_secs) = (rad, 0.0);
            return;
        }
        let speed = moved * share.signum() / secs;
        if share.abs() >= PUSHED_SHARE {
            for (ran_rad, runs) in
                [(&mut self.ran_rad, RUNS_RAD_S), (&mut self.ran_fast_rad, RUNS_FAST_RAD_S)]
            {
                if speed > 0.0 || speed < -runs {
                    *ran_rad = (*ran_rad - moved * share.signum()).max(0.0);
                }
            }
        }
        if share.abs() >= HARD_SHARE && (rad - self.stands_at).abs() <= STANDS_RAD {
            self.hard_secs += secs;
        } else {
            (self.stands_at, self.hard_secs) = (rad, 0.0);
        }
    }
}

/// Whether a joint of the wrong sign ends at this reading if it is pushed in this direction: at the
/// stop that its reading mirrors, or, blocked on the way there, beyond the other one.
fn ends_there(joint: usize, rad: f64, share: f64) -> bool {
    let Some([low, high]) = JOINT_LIMITS_RAD.get(joint) else { return false };
    if share > 0.0 {
        rad < low - BEYOND_RAD || (-STOP_OUTSIDE_RAD..=NEAR_STOP_RAD).contains(&(high + rad))
    } else {
        rad > high + BEYOND_RAD || (-NEAR_STOP_RAD..=STOP_OUTSIDE_RAD).contains(&(low + rad))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is found within two seconds of a joint at `what(s)`: position, reference, torque.
    fn found(joint: usize, what: impl Fn(f64) -> (f64, f64, f64)) -> Option<(f64, Implausible)> {
        let mut runaways = Runaways::default();
        (0..666u32).find_map(|period| {
            let at = Duration::from_millis(3) * period;
            let [mut positions, mut reference, mut shares] = [[0.0; WIRE_JOINTS]; 3];
            (positions[joint], reference[joint], shares[joint]) = what(at.as_secs_f64());
            let found = runaways.take(at, &positions, &reference, &shares, [false; PLAYING]);
            found.map(|found| (at.as_secs_f64(), found))
        })
    }

    /// From 0 rad at half a second, at this speed (rad/s), to `end` (rad).
    fn run(secs: f64, speed: f64, end: f64) -> f64 {
        (speed * (secs - 0.5).max(0.0)).min(end.abs()).copysign(end)
    }

    #[test]
    fn a_joint_that_ends_at_a_mirrored_stop_is_found_within_half_a_second() {
        for (joint, end) in [(5, 0.2), (15, 0.16), (5, -0.4), (4, 0.4), (8, -0.2)] {
            let (at, _) = found(joint, |secs| (run(secs, 4.0, end), 0.0, -end.signum())).unwrap();
            assert!((0.8..1.0).contains(&at), "joint {joint} to {end}: {at} s");
        }
    }

    #[test]
    fn what_a_key_a_person_or_a_stop_does_is_not_that() {
        // A person bends a finger, and holds it; a key keeps it from bending.
        assert_eq!(found(5, |secs| (run(secs, 4.0, 0.8), 0.0, -1.0)), None);
        assert_eq!(found(4, |secs| (run(secs, 1.5, 0.3), 0.0, -1.0)), None);
        assert_eq!(found(6, |secs| (0.9 - run(secs, 4.0, 0.5), 0.9, 1.0)), None);
        // Pushed against its own stop, and held there by little.
        assert_eq!(found(5, |secs| (run(secs, 4.0, -0.2), -0.4, -1.0)), None);
        assert_eq!(found(5, |secs| (run(secs, 4.0, 0.2), 0.0, -0.5)), None);
        // It obeyed before it was held there.
        assert_eq!(found(5, |secs| (0.8 - run(secs, 4.0, 0.6), 0.0, -1.0)), None);
    }
}
