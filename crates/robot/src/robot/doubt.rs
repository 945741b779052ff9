//! Measurements that are doubted: values that repeat while the robot was sent elsewhere, joints that push at their limit for long or
//! stand although they are pushed both ways, and an arm that is not where it was sent.
//!
//! The thresholds are judgements. Playing on the twin (`standard` and `worn`, real execution) reaches 0.57 of the 0.8 for torques, 38 of the
//! 80 mm along the keyboard, and no finger repeats itself.

use std::time::Duration;

use super::turning::Turning;
use crate::allegro::{JOINTS, PWM_LIMITS};
use crate::calibration::RailPlace;
use crate::xarm::{kinematics, largest_turn};

/// Shortest time for which repeated values are doubted.
const REPEATED: Duration = Duration::from_millis(100);
/// How far a joint of a finger was sent meanwhile, rad.
const SENT_RAD: f64 = 0.15;
/// How far the arm was sent along the keyboard meanwhile, m.
const SENT_M: f64 = 0.02;
/// Share of these at which the time begins: before, a joint is as good as at rest.
const AWAY_SHARE: f64 = 0.1;
/// Time in which a motor warms up, s. The torque is taken as a share of the joint's limit, squared as the losses of a motor are.
const WARMING_SECS: f64 = 10.0;
/// The mean of these squares that is too much: sixteen seconds at the limit from rest.
const TOO_WARM: f64 = 0.8;
/// Longest time for which the arm may be away from where it was sent.
const AWAY: Duration = Duration::from_millis(150);
/// How far along the keyboard, m, while it is sent nowhere, and at most: a tenth of a second at the highest speed of the rail.
const AWAY_AT_REST_M: f64 = 0.02;
const AWAY_M: f64 = 0.08;
/// Lag of the arm by which it may be farther away while it is sent along the keyboard, s, and how fast the speed is forgotten, s.
const LAG_SECS: f64 = 0.1;
const SPEED_SECS: f64 = 0.3;
/// How far a joint of the arm may be from where it stands away from the keyboard, rad.
const MOVED_RAD: f64 = 0.02;
/// How far a joint of the arm may be from where it was sent on the way to the keyboard, rad: a third of a second at the speed of that way.
const AWAY_RAD: f64 = 0.1;
/// How far a joint of the arm was sent on that way while its reports repeat, rad.
const SENT_ARM_RAD: f64 = 0.05;
/// How far beside its path, m, and how far turned, rad.
const BESIDE_M: f64 = 0.015;
const TURNED_RAD: f64 = 0.1;

/// What is doubted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Doubt {
    /// All joints of a finger report the same angles, and the finger was sent elsewhere.
    #[error(
        "finger {finger} of the hand has reported the same angles for {} ms while it was sent {sent_rad:.2} rad to and fro: check its encoders and \
         whether something blocks it",
        since.as_millis()
    )]
    FingerRepeats {
        /// Which finger, as on the wire.
        finger: usize,
        /// For how long.
        since: Duration,
        /// How far it was sent.
        sent_rad: f64,
    },
    /// A joint of the hand pushes at its limit for long.
    #[error(
        "joint {joint} of the hand has pushed with {:.0} % of its greatest torque in the mean of the last seconds, and its motor gets hot: see \
         what blocks it",
        100.0 * share
    )]
    Pushing {
        /// Which joint, as on the wire.
        joint: usize,
        /// Root of the mean square of its torque, as a share of the limit.
        share: f64,
    },
    /// A joint of the hand is pushed both ways and does not turn.
    #[error(
        "joint {joint} of the hand stays at {rad:.2} rad although it was pushed both ways: see what blocks it, and check its motor, its \
         encoder and their cables"
    )]
    Stands {
        /// Which joint, as on the wire.
        joint: usize,
        /// Where it stays.
        rad: f64,
    },
    /// The arm reports the same angles, and was sent elsewhere.
    #[error(
        "the arm has reported the same angles for {} ms while it was sent {:.0} mm to and fro: see what holds it, and look at its control box",
        since.as_millis(),
        sent_m * 1e3
    )]
    ArmRepeats {
        /// For how long.
        since: Duration,
        /// How far it was sent.
        sent_m: f64,
    },
    /// The arm reports the same angles on its way to the keyboard.
    #[error(
        "the arm has reported the same angles for {} ms while it was sent {sent_rad:.2} rad on its way: see what holds it, and look at its control \
         box",
        since.as_millis()
    )]
    ArmRepeatsOnWay {
        /// For how long.
        since: Duration,
        /// How far it was sent.
        sent_rad: f64,
    },
    /// The arm is not where it was sent on its way to the keyboard, or not where it stood.
    #[error(
        "joint {joint} of the arm is {by_rad:.2} rad from where it was sent or stood: see what holds it, and whether another program moves it"
    )]
    ArmOffWay {
        /// Which joint, counted from 1.
        joint: usize,
        /// How far, rad.
        by_rad: f64,
    },
    /// The arm is not where it was sent.
    #[error(
        "the arm is {:.0} mm from where it was sent along the keyboard, {:.0} mm beside its path and turned by {turned_rad:.2} rad: see what \
         holds it, and whether another program moves it",
        along_m * 1e3,
        beside_m * 1e3
    )]
    ArmAway {
        /// How far along the keyboard, m.
        along_m: f64,
        /// How far beside its path, m.
        beside_m: f64,
        /// How far turned, rad.
        turned_rad: f64,
    },
}

/// Values that were reported, and the lowest and highest places where the joints were sent while they stayed the same.
#[derive(Clone, Copy, Debug)]
struct Reported<const N: usize, const SENT: usize> {
    values: [f64; N],
    /// When the joints were first sent away.
    since: Duration,
    sent: [[f64; 2]; SENT],
}

impl<const N: usize, const SENT: usize> Reported<N, SENT> {
    /// Takes new values; if they stay the same although the joints were sent to and fro by more than `least`, for how long, and how far.
    fn take(
        this: &mut Option<Self>,
        at: Duration,
        values: [f64; N],
        sent: [f64; SENT],
        least: f64,
    ) -> Option<(Duration, f64)> {
        let new = Self { values, since: at, sent: sent.map(|sent| [sent; 2]) };
        let reported = this.get_or_insert(new);
        if reported.values != values {
            *reported = new;
        }
        let mut farthest = 0.0f64;
        for ([low, high], sent) in reported.sent.iter_mut().zip(sent) {
            (*low, *high) = (low.min(sent), high.max(sent));
            farthest = farthest.max(*high - *low);
        }
        if farthest <= least * AWAY_SHARE {
            reported.since = at;
        }
        let since = at.saturating_sub(reported.since);
        (since >= REPEATED && farthest > least).then_some((since, farthest))
    }
}

const FINGERS: usize = JOINTS / 4;

/// Watches what hand and arm report.
#[derive(Clone, Debug, Default)]
pub(super) struct Doubts {
    fingers: [Option<Reported<4, 4>>; FINGERS],
    hand_at: Option<Duration>,
    warm: [f64; JOINTS],
    turning: Turning,
    arm: Option<Reported<{ kinematics::JOINTS }, 1>>,
    arm_way: Option<Reported<{ kinematics::JOINTS }, { kinematics::JOINTS }>>,
    away_since: Option<Duration>,
    /// When the arm reported last, where it was sent then along the keyboard, m, and the greatest speed of that lately, m/s.
    arm_at: Option<Duration>,
    arm_sent_m: Option<f64>,
    arm_speed: f64,
    found: Option<Doubt>,
}

impl Doubts {
    /// Takes a period's angles, where the joints were sent (rad), and the torques.
    pub fn hand(
        &mut self,
        at: Duration,
        positions: &[f64; JOINTS],
        reference: &[f64; JOINTS],
        pwm: &[i16; JOINTS],
    ) {
        if let Some(doubt) = self.turning.take(at, positions, reference) {
            self.found.get_or_insert(doubt);
        }
        let (positions, _) = positions.as_chunks::<4>();
        let (reference, _) = reference.as_chunks::<4>();
        for (finger, (reported, (positions, reference))) in
            self.fingers.iter_mut().zip(positions.iter().zip(reference)).enumerate()
        {
            if let Some((since, sent_rad)) = Reported::take(reported, at, *positions, *reference, SENT_RAD) {
                self.found.get_or_insert(Doubt::FingerRepeats { finger, since, sent_rad });
            }
        }
        let secs = at.saturating_sub(self.hand_at.unwrap_or(at)).as_secs_f64();
        self.hand_at = Some(at);
        let part = (secs / WARMING_SECS).min(1.0);
        for (joint, (warm, (pwm, limit))) in self.warm.iter_mut().zip(pwm.iter().zip(PWM_LIMITS)).enumerate()
        {
            let share = f64::from(*pwm) / f64::from(limit);
            *warm += part * (share * share - *warm);
            if *warm > TOO_WARM {
                self.found.get_or_insert(Doubt::Pushing { joint, share: warm.sqrt() });
            }
        }
    }

    /// Takes a report of the arm, where that is, and where the arm was sent last along the keyboard, m.
    pub fn arm(
        &mut self,
        at: Duration,
        joints: &[f64; kinematics::JOINTS],
        place: &RailPlace,
        sent_rail_m: f64,
    ) {
        if let Some((since, sent_m)) = Reported::take(&mut self.arm, at, *joints, [sent_rail_m], SENT_M) {
            self.found.get_or_insert(Doubt::ArmRepeats { since, sent_m });
        }
        let secs = at.saturating_sub(self.arm_at.unwrap_or(at)).as_secs_f64();
        let before_m = self.arm_sent_m.unwrap_or(sent_rail_m);
        self.arm_speed *= (-secs / SPEED_SECS).exp();
        if secs > 0.0 {
            self.arm_speed = self.arm_speed.max((sent_rail_m - before_m).abs() / secs);
        }
        (self.arm_at, self.arm_sent_m) = (Some(at), Some(sent_rail_m));
        let allowed_m = (AWAY_AT_REST_M + LAG_SECS * self.arm_speed).min(AWAY_M);
        let along_m = (place.rail_m - sent_rail_m).abs();
        let (beside_m, turned_rad) = (place.beside_m, place.turned_rad);
        if along_m <= allowed_m && beside_m <= BESIDE_M && turned_rad <= TURNED_RAD {
            self.away_since = None;
        } else if at.saturating_sub(*self.away_since.get_or_insert(at)) > AWAY {
            self.found.get_or_insert(Doubt::ArmAway { along_m, beside_m, turned_rad });
        }
    }

    /// The same on the arm's way to the keyboard, or while it stands away from it; `sent` are joints (rad).
    pub fn arm_elsewhere(
        &mut self,
        at: Duration,
        joints: &[f64; kinematics::JOINTS],
        sent: &[f64; kinematics::JOINTS],
        on_its_way: bool,
    ) {
        let repeated = Reported::take(&mut self.arm_way, at, *joints, *sent, SENT_ARM_RAD);
        if let Some((since, sent_rad)) = repeated {
            self.found.get_or_insert(Doubt::ArmRepeatsOnWay { since, sent_rad });
        }
        let (joint, by_rad) = largest_turn(joints, sent);
        if by_rad <= if on_its_way { AWAY_RAD } else { MOVED_RAD } {
            self.away_since = None;
        } else if at.saturating_sub(*self.away_since.get_or_insert(at)) > AWAY {
            self.found.get_or_insert(Doubt::ArmOffWay { joint, by_rad });
        }
    }

    /// The arm has come to the keyboard: what it reported before does not count.
    pub fn arm_has_arrived(&mut self) {
        (self.arm, self.arm_way, self.away_since) = (None, None, None);
        (self.arm_at, self.arm_sent_m, self.arm_speed) = (None, None, 0.0);
    }

    /// The first thing that is doubted.
    pub fn found(&self) -> Option<&Doubt> {
        self.found.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(3);

    /// The doubt after `count` periods of `what`.
    fn after(
        count: u32,
        what: impl Fn(u32) -> ([f64; JOINTS], [f64; JOINTS], [i16; JOINTS]),
    ) -> Option<Doubt> {
        let mut doubts = Doubts::default();
        for period in 0..count {
            let (positions, reference, pwm) = what(period);
            doubts.hand(PERIOD * period, &positions, &reference, &pwm);
        }
        doubts.found().cloned()
    }

    #[test]
    fn a_finger_that_repeats_itself_is_doubted_and_one_at_rest_is_not() {
        let moving = |period: u32| [0.001 * f64::from(period); JOINTS];
        let stuck = |finger: Option<usize>| {
            after(400, |period| {
                let mut positions = moving(period);
                if let Some(finger) = finger {
                    positions[4 * finger..4 * finger + 4].fill(0.1);
                }
                (positions, moving(period), [0; JOINTS])
            })
        };
        assert_eq!(stuck(None), None);
        let found = stuck(Some(2));
        assert!(matches!(found, Some(Doubt::FingerRepeats { finger: 2, .. })), "{found:?}");
        // One that rests, and sets out 60 ms after it was sent, does not.
        let late = after(400, |period| {
            let sent = |period: u32| 0.01 * f64::from(period.saturating_sub(200));
            ([sent(period.saturating_sub(20)); JOINTS], [sent(period); JOINTS], [0; JOINTS])
        });
        assert_eq!(late, None);
        // One joint that stands is not the encoder's fault, and nobody is sent anywhere at rest.
        let one = after(400, |period| {
            let mut positions = moving(period);
            positions[5] = 0.1;
            (positions, moving(period), [0; JOINTS])
        });
        assert_eq!(one, None);
        assert_eq!(after(4000, |_| ([0.1; JOINTS], [0.1; JOINTS], [0; JOINTS])), None);
    }

    #[test]
    fn a_joint_may_push_hard_but_not_for_long() {
        let pushing = |secs: u32, share: f64| {
            after(secs * 333, |period| {
                let mut pwm = [0; JOINTS];
                pwm[9] = (f64::from(PWM_LIMITS[9]) * share) as i16;
                ([f64::from(period); JOINTS], [f64::from(period); JOINTS], pwm)
            })
        };
        assert_eq!(pushing(15, -1.0), None);
        assert!(matches!(pushing(18, -1.0), Some(Doubt::Pushing { joint: 9, .. })));
        assert_eq!(pushing(120, 0.85), None, "three quarters of the heat");
    }

    #[test]
    fn an_arm_away_from_the_keyboard_is_where_it_was_sent_or_stood() {
        let arm = |on_its_way: bool, what: &dyn Fn(f64) -> ([f64; 7], [f64; 7])| {
            let mut doubts = Doubts::default();
            for report in 0..200 {
                let (joints, sent) = what(f64::from(report) * 0.01);
                doubts.arm_elsewhere(Duration::from_millis(10) * report, &joints, &sent, on_its_way);
            }
            doubts.found().cloned()
        };
        // 0.15 s late at 0.3 rad/s.
        assert_eq!(arm(true, &|secs| ([0.3 * (secs - 0.15).max(0.0); 7], [0.3 * secs; 7])), None);
        let off = arm(true, &|secs| ([0.3 * (secs - 0.5); 7], [0.3 * secs; 7]));
        assert!(matches!(off, Some(Doubt::ArmOffWay { joint: 1, .. })), "{off:?}");
        let repeats = arm(true, &|secs| ([0.0; 7], [0.3 * secs; 7]));
        assert!(matches!(repeats, Some(Doubt::ArmRepeatsOnWay { .. })), "{repeats:?}");
        assert_eq!(arm(false, &|_| ([0.1; 7], [0.1; 7])), None);
        let moved = arm(false, &|secs| ([0.1 + 0.05 * secs; 7], [0.1; 7]));
        assert!(matches!(moved, Some(Doubt::ArmOffWay { .. })), "{moved:?}");
    }

    #[test]
    fn an_arm_that_stands_or_is_elsewhere_is_doubted() {
        let arm = |count: u32, what: &dyn Fn(f64) -> ([f64; 7], RailPlace, f64)| {
            let mut doubts = Doubts::default();
            for report in 0..count {
                let (joints, place, sent) = what(f64::from(report) * 0.01);
                doubts.arm(Duration::from_millis(10) * report, &joints, &place, sent);
            }
            doubts.found().cloned()
        };
        let place = |rail_m| RailPlace { rail_m, beside_m: 0.001, turned_rad: 0.01 };
        // 70 ms late at 0.8 m/s.
        assert_eq!(arm(60, &|secs| ([secs; 7], place(0.8 * (secs - 0.07)), 0.8 * secs)), None);
        let repeats = arm(60, &|secs| ([0.3; 7], place(0.0), 0.1 * secs));
        assert!(matches!(repeats, Some(Doubt::ArmRepeats { .. })), "{repeats:?}");
        let away = arm(60, &|secs| ([secs; 7], place(0.0), 0.021));
        assert!(matches!(away, Some(Doubt::ArmAway { .. })), "{away:?}");
        let beside = arm(60, &|secs| ([secs; 7], RailPlace { beside_m: 0.02, ..place(0.0) }, 0.0));
        assert!(matches!(beside, Some(Doubt::ArmAway { .. })), "{beside:?}");
        // A short knock is none.
        assert_eq!(arm(60, &|secs| ([secs; 7], place(if secs < 0.14 { 0.09 } else { 0.0 }), 0.0)), None);
        // Half a second after it was sent along the keyboard, it must be there.
        let stops = |behind: f64| {
            arm(120, &|secs| {
                (
                    [secs; 7],
                    place(0.5 * (secs - 0.1).clamp(0.0, 0.3) - if secs > 0.5 { behind } else { 0.0 }),
                    0.5 * secs.min(0.3),
                )
            })
        };
        assert_eq!(stops(0.015), None);
        assert!(matches!(stops(0.045), Some(Doubt::ArmAway { .. })), "{:?}", stops(0.045));
        assert_eq!(arm(600, &|_| ([0.3; 7], place(0.0), 0.0)), None, "at rest");
    }
}
