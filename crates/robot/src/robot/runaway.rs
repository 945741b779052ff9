//! Joints of the hand that turn against their torque: the encoder or the motor counts in the wrong
//! direction.
//!
//! Such a joint runs away from its reference to a stop, and is pushed against that with all its
//! torque. A key or a person can bring a finger to the same place, and what is measured does not
//! tell who did. So a joint that stands although it is pushed hard is asked once: for a moment it
//! is pushed the other way. Only a joint of the wrong sign then comes nearer to its reference. A
//! finger that may be on a key is not asked: a note would stop, and the arm may drag it along
//! meanwhile.

use std::time::Duration;

use crate::allegro::{PLAYING, WIRE_JOINTS};

/// How hard (as a share of the limit), how long (s) and how still (rad) a joint stands that is
/// probed.
const HARD_SHARE: f64 = 0.7;
const HARD_SECS: f64 = 0.3;
const STANDS_RAD: f64 = 0.03;
/// With which share of its limit and how long it is pushed the other way, and how much nearer it
/// must come, rad.
const PROBE_SHARE: f64 = 0.5;
const PROBE_TIME: Duration = Duration::from_millis(80);
const NEARER_RAD: f64 = 0.03;
/// A longer time between two readings says nothing, s.
const MAX_SECS: f64 = 0.05;

#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    stands_at: f64,
    /// How long it has been pushed hard there.
    hard_secs: f64,
    probe: Option<SignProbe>,
    /// Where it stood when a probe found its sign right.
    obeyed_at: Option<f64>,
}

/// A joint is pushed the other way.
#[derive(Clone, Copy, Debug)]
struct SignProbe {
    since: Duration,
    from_rad: f64,
    /// The direction of its reference.
    toward: f64,
}

/// Watches whether the joints of the hand turn as they are pushed.
#[derive(Clone, Debug, Default)]
pub(super) struct Runaways {
    joints: [Joint; WIRE_JOINTS],
    at: Option<Duration>,
}

impl Runaways {
    /// Pushes the joints that are probed the other way, whatever is wanted of them.
    pub fn override_with_probe(&self, wanted: &mut [f64; WIRE_JOINTS], limits: &[i16; WIRE_JOINTS]) {
        for ((wanted, joint), limit) in wanted.iter_mut().zip(&self.joints).zip(limits) {
            if let Some(probe) = joint.probe {
                *wanted = -probe.toward * PROBE_SHARE * f64::from(*limit);
            }
        }
    }

    /// Takes a period's angles, where the joints were sent (rad), their torques as shares of their
    /// limits, and which fingers may press a key. The first joint of the wrong sign, if any, and
    /// where, rad.
    pub fn take(
        &mut self,
        at: Duration,
        positions: &[f64; WIRE_JOINTS],
        reference: &[f64; WIRE_JOINTS],
        shares: &[f64; WIRE_JOINTS],
        may_press: [bool; PLAYING],
    ) -> Option<(usize, f64)> {
        let secs = at.saturating_sub(self.at.replace(at).unwrap_or(at)).as_secs_f64();
        let mut found = None;
        for (joint, state) in self.joints.iter_mut().enumerate() {
            let (rad, share) = (positions[joint], shares[joint]);
            if may_press.get(joint / 4) == Some(&true) {
                (state.probe, state.stands_at, state.hard_secs) = (None, rad, 0.0);
                continue;
            }
            if state.probe.is_some() {
                if state.has_wrong_sign(at, rad) {
                    found = found.or(Some((joint, rad)));
                }
                continue;
            }
            state.push(secs, rad, reference[joint], share);
            let obeys = state.obeyed_at.is_some_and(|at| (rad - at).abs() <= STANDS_RAD);
            if state.hard_secs > HARD_SECS && !obeys {
                state.probe = Some(SignProbe { since: at, from_rad: rad, toward: share.signum() });
            }
        }
        found
    }
}

impl Joint {
    fn push(&mut self, secs: f64, rad: f64, reference: f64, share: f64) {
        let is_hard = share.abs() >= HARD_SHARE && (reference - rad) * share > 0.0;
        if secs <= MAX_SECS && is_hard && (rad - self.stands_at).abs() <= STANDS_RAD {
            self.hard_secs += secs;
        } else {
            (self.stands_at, self.hard_secs) = (rad, 0.0);
        }
    }

    /// Whether it has come nearer to its reference although it is pushed the other way.
    fn has_wrong_sign(&mut self, at: Duration, rad: f64) -> bool {
        let Some(probe) = self.probe else { return false };
        if (rad - probe.from_rad) * probe.toward > NEARER_RAD {
            return true;
        }
        if at.saturating_sub(probe.since) > PROBE_TIME {
            let obeyed_at = Some(probe.from_rad);
            *self = Self { stands_at: rad, obeyed_at, ..Self::default() };
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::allegro::PWM_LIMITS;

    const PERIOD: Duration = Duration::from_millis(3);

    /// A joint between its stops at ±0.3 rad, as fast as it is pushed; how its reading counts; and
    /// where somebody holds it, if so, at a time (s).
    struct Plant {
        joint: usize,
        sign: f64,
        from: f64,
        reference: fn(f64) -> f64,
        held: fn(f64) -> Option<f64>,
        on_key: bool,
    }

    impl Plant {
        /// When it is found within three seconds, s, and how many periods it was asked.
        fn run(&self) -> (Option<f64>, u32) {
            let (mut runaways, mut angle, mut asked) = (Runaways::default(), self.from, 0);
            for period in 0..1000u32 {
                let at = PERIOD * period;
                let secs = at.as_secs_f64();
                angle = (self.held)(secs).unwrap_or(angle);
                let [mut positions, mut reference, mut shares] = [[0.0; WIRE_JOINTS]; 3];
                positions[self.joint] = self.sign * angle;
                reference[self.joint] = (self.reference)(secs);
                let by_rad = reference[self.joint] - positions[self.joint];
                let limit = f64::from(PWM_LIMITS[self.joint]);
                let mut wanted = [0.0; WIRE_JOINTS];
                wanted[self.joint] = limit * (8.0 * by_rad).clamp(-1.0, 1.0);
                runaways.override_with_probe(&mut wanted, &PWM_LIMITS);
                shares[self.joint] = wanted[self.joint] / limit;
                asked += u32::from(shares[self.joint] * by_rad < 0.0);
                let on_key = [self.on_key; PLAYING];
                if runaways.take(at, &positions, &reference, &shares, on_key).is_some() {
                    return (Some(secs), asked);
                }
                angle = (angle + 4.0 * shares[self.joint] * PERIOD.as_secs_f64()).clamp(-0.3, 0.3);
            }
            (None, asked)
        }
    }

    const SOUND: Plant =
        Plant { joint: 5, sign: 1.0, from: 0.01, reference: |_| 0.0, held: |_| None, on_key: false };

    #[test]
    fn a_joint_of_the_wrong_sign_is_found_within_a_second() {
        for joint in 0..WIRE_JOINTS {
            for from in [-0.3, -0.01, 0.01, 0.3] {
                let plant = Plant { joint, sign: -1.0, from, ..SOUND };
                let (at, asked) = plant.run();
                assert!(at.is_some_and(|at| at < 1.0) && asked < 30, "joint {joint} from {from}: {at:?}");
            }
        }
    }

    #[test]
    fn a_joint_that_is_held_is_asked_once() {
        let held: [fn(f64) -> Option<f64>; 3] =
            [|_| Some(0.25), |secs| (secs < 1.5).then_some(-0.2), |secs| Some((3.0 * secs).min(0.2))];
        for held in held {
            let (at, asked) = Plant { held, ..SOUND }.run();
            assert!(at.is_none() && (20..40).contains(&asked), "{at:?}, {asked}");
        }
        // Against its own stop, too.
        let (at, asked) = Plant { reference: |_| 0.6, ..SOUND }.run();
        assert!(at.is_none() && (20..40).contains(&asked), "{at:?}, {asked}");
        // A finger on a key and one that obeys are never asked.
        assert_eq!(Plant { held: |_| Some(-0.25), on_key: true, ..SOUND }.run(), (None, 0));
        assert_eq!(Plant { reference: |secs| 0.25 * (6.0 * secs).sin(), ..SOUND }.run().0, None);
    }
}
