//! Measurements that are not plausible: values that repeat while the robot was sent elsewhere,
//! joints that push at their limit for long, stand although they are pushed both ways or turn
//! against their torque, and an arm that is not where it was sent.
//!
//! The thresholds are judgements. Playing on the twin (`standard` and `worn`, real execution)
//! reaches 0.57 of the 0.8 for torques, 38 of the 80 mm along the keyboard, and no finger repeats
//! itself.

use std::time::Duration;

use super::foreign_targets::{Foreign, ForeignTargets};
use super::motor_heat::MotorHeat;
use super::runaway::Runaways;
use super::stuck_joint::StuckJoints;
use crate::allegro::{PLAYING, WIRE_JOINTS};
use crate::calibration::RailPlace;
use crate::xarm::{kinematics, largest_turn};

/// Shortest time for which repeated values are not plausible.
const REPEATED: Duration = Duration::from_millis(100);
/// How far a joint of a finger was sent meanwhile, rad.
const SENT_RAD: f64 = 0.15;
/// How far the arm was sent along the keyboard meanwhile, m.
const SENT_M: f64 = 0.02;
/// Share of these at which the time begins: before, a joint is as good as at rest.
const AWAY_SHARE: f64 = 0.1;
/// Longest time for which the arm may be away from where it was sent.
const AWAY: Duration = Duration::from_millis(150);
/// How far along the keyboard, m, while it is sent nowhere, and at most: a tenth of a second at the
/// highest speed of the rail.
const AWAY_AT_REST_M: f64 = 0.02;
const AWAY_M: f64 = 0.08;
/// Lag of the arm by which it may be farther away while it is sent along the keyboard, s, and how
/// fast the speed is forgotten, s.
const LAG_SECS: f64 = 0.1;
const SPEED_SECS: f64 = 0.3;
/// How far a joint of the arm may be from where it stands away from the keyboard, rad.
const MOVED_RAD: f64 = 0.02;
/// How far a joint of the arm may be from where it was sent on the way to the keyboard, rad: a
/// third of a second at the speed of that way.
const AWAY_RAD: f64 = 0.1;
/// How far a joint of the arm was sent on that way while its reports repeat, rad.
const SENT_ARM_RAD: f64 = 0.05;
/// How far beside its path, m, and how far turned, rad.
const BESIDE_M: f64 = 0.015;
const TURNED_RAD: f64 = 0.1;

/// What is not plausible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Implausible {
    /// All joints of a finger report the same angles, and the finger was sent elsewhere.
    #[error(
        "finger {finger} of the hand has reported the same angles for {} ms while it was sent {sent_rad:.2} rad back and forth: check its encoders \
         and whether something blocks it",
        since.as_millis()
    )]
    FingerFrozen {
        /// Which finger, as on the wire.
        finger: usize,
        /// For how long.
        since: Duration,
        /// How far it was sent.
        sent_rad: f64,
    },
    /// A joint of the hand pushes at its limit for long.
    #[error(
        "joint {joint} of the hand has pushed with {:.0} % of its greatest torque on average over the last seconds, and its motor gets hot: see \
         what blocks it",
        100.0 * share
    )]
    MotorHot {
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
    JointStuck {
        /// Which joint, as on the wire.
        joint: usize,
        /// Where it stays.
        rad: f64,
    },
    /// A joint of the hand turns against its torque.
    #[error(
        "joint {joint} of the hand turns against its torque (at {rad:.2} rad): its encoder or its motor is connected the wrong way; do not run \
         this hand before `etude robot check --joints` finds it right"
    )]
    JointRunsAway {
        /// Which joint, as on the wire.
        joint: usize,
        /// Where it is, rad.
        rad: f64,
    },
    /// The arm reports the same angles, and was sent elsewhere.
    #[error(
        "the arm has reported the same angles for {} ms while it was sent {:.0} mm back and forth: see what holds it, whether another program \
         keeps it there, and look at its control box",
        since.as_millis(),
        sent_m * 1e3
    )]
    ArmFrozen {
        /// For how long.
        since: Duration,
        /// How far it was sent.
        sent_m: f64,
    },
    /// The arm reports the same angles on its way to the keyboard.
    #[error(
        "the arm has reported the same angles for {} ms while it was sent {sent_rad:.2} rad on its path: see what holds it, whether another \
         program keeps it there, and look at its control box",
        since.as_millis()
    )]
    ArmFrozenOnPath {
        /// For how long.
        since: Duration,
        /// How far it was sent.
        sent_rad: f64,
    },
    /// The arm is not where it was sent on its way to the keyboard, or not where it stood.
    #[error(
        "joint {joint} of the arm is {by_rad:.2} rad from where it was sent or stood: see what holds it, and whether another program moves it"
    )]
    ArmOffPath {
        /// Which joint, counted from 1.
        joint: usize,
        /// How far, rad.
        by_rad: f64,
    },
    /// The arm reports a target that this program has not sent.
    #[error(
        "another program sends targets to the arm ({by_rad:.3} rad from all that this program has sent joint {joint}): close UFACTORY Studio and \
         other scripts that use the arm, then start again"
    )]
    ArmTargetForeign {
        /// Which joint, counted from 1.
        joint: usize,
        /// How far, rad.
        by_rad: f64,
    },
    /// The arm is where it was not sent lately.
    #[error(
        "joint {joint} of the arm is {by_rad:.3} rad from everywhere it was sent in the last half second: another program sends targets to the \
         arm (close UFACTORY Studio and other scripts that use it), or something holds or pushes it (see what holds it)"
    )]
    ArmElsewhere {
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

impl Implausible {
    /// Whether an arm whose targets come too late looks like this.
    pub fn is_lag(&self) -> bool {
        matches!(self, Self::ArmAway { .. } | Self::ArmOffPath { .. })
    }
}

/// Values that were reported, and the lowest and highest places where the joints were sent while
/// they stayed the same.
#[derive(Clone, Copy, Debug)]
struct Reported<const N: usize, const SENT: usize> {
    values: [f64; N],
    /// When the joints were first sent away.
    since: Duration,
    sent: [[f64; 2]; SENT],
}

impl<const N: usize, const SENT: usize> Reported<N, SENT> {
    /// Takes new values; if they stay the same although the joints were sent back and forth by more
    /// than `least`, for how long, and how far.
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

const FINGERS: usize = WIRE_JOINTS / 4;

/// Watches what hand and arm report.
#[derive(Clone, Debug, Default)]
pub(super) struct PlausibilityChecks {
    fingers: [Option<Reported<4, 4>>; FINGERS],
    pub motor_heat: MotorHeat,
    stuck: StuckJoints,
    runaways: Runaways,
    foreign: ForeignTargets,
    arm: Option<Reported<{ kinematics::ARM_JOINTS }, 1>>,
    arm_way: Option<Reported<{ kinematics::ARM_JOINTS }, { kinematics::ARM_JOINTS }>>,
    away_since: Option<Duration>,
    /// When the arm reported last, where it was sent then along the keyboard, m, and the greatest
    /// speed of that lately, m/s.
    arm_at: Option<Duration>,
    arm_sent_m: Option<f64>,
    arm_speed: f64,
    found: Option<Implausible>,
}

impl PlausibilityChecks {
    /// Nothing but the heat of the motors counts any more.
    pub fn begin_anew(&mut self) {
        *self = Self { motor_heat: self.motor_heat, ..Self::default() };
    }

    /// Takes a period's angles, where the joints were sent (rad), the torques and their limits, and
    /// which fingers may press a key.
    pub fn hand(
        &mut self,
        at: Duration,
        positions: &[f64; WIRE_JOINTS],
        reference: &[f64; WIRE_JOINTS],
        pwm: &[i16; WIRE_JOINTS],
        limits: &[i16; WIRE_JOINTS],
        may_press: [bool; PLAYING],
    ) {
        if let Some((joint, rad)) = self.stuck.take(at, positions, reference, may_press) {
            self.found.get_or_insert(Implausible::JointStuck { joint, rad });
        }
        let shares = std::array::from_fn(|joint| f64::from(pwm[joint]) / f64::from(limits[joint].max(1)));
        if let Some((joint, rad)) = self.runaways.take(at, positions, reference, &shares, may_press) {
            self.found.get_or_insert(Implausible::JointRunsAway { joint, rad });
        }
        let (positions, _) = positions.as_chunks::<4>();
        let (reference, _) = reference.as_chunks::<4>();
        for (finger, (reported, (positions, reference))) in
            self.fingers.iter_mut().zip(positions.iter().zip(reference)).enumerate()
        {
            if let Some((since, sent_rad)) = Reported::take(reported, at, *positions, *reference, SENT_RAD) {
                self.found.get_or_insert(Implausible::FingerFrozen { finger, since, sent_rad });
            }
        }
        self.motor_heat.take(at, pwm);
        if let Some((joint, heat)) = self.motor_heat.too_hot() {
            self.found.get_or_insert(Implausible::MotorHot { joint, share: heat.sqrt() });
        }
    }

    /// Pushes a joint the other way whose sign is in doubt.
    pub fn override_with_probe(&self, wanted: &mut [f64; WIRE_JOINTS], limits: &[i16; WIRE_JOINTS]) {
        self.runaways.override_with_probe(wanted, limits);
    }

    /// Takes a report of the arm, where that is, and where the arm was sent last along the
    /// keyboard, m.
    pub fn arm(
        &mut self,
        at: Duration,
        joints: &[f64; kinematics::ARM_JOINTS],
        place: &RailPlace,
        sent_rail_m: f64,
    ) {
        if let Some((since, sent_m)) = Reported::take(&mut self.arm, at, *joints, [sent_rail_m], SENT_M) {
            self.found.get_or_insert(Implausible::ArmFrozen { since, sent_m });
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
            self.found.get_or_insert(Implausible::ArmAway { along_m, beside_m, turned_rad });
        }
    }

    /// The same on the arm's way to the keyboard, or while it stands away from it; `sent` are
    /// joints (rad).
    pub fn arm_elsewhere(
        &mut self,
        at: Duration,
        joints: &[f64; kinematics::ARM_JOINTS],
        sent: &[f64; kinematics::ARM_JOINTS],
        on_its_way: bool,
    ) {
        let repeated = Reported::take(&mut self.arm_way, at, *joints, *sent, SENT_ARM_RAD);
        if let Some((since, sent_rad)) = repeated {
            self.found.get_or_insert(Implausible::ArmFrozenOnPath { since, sent_rad });
        }
        let (joint, by_rad) = largest_turn(joints, sent);
        if by_rad <= if on_its_way { AWAY_RAD } else { MOVED_RAD } {
            self.away_since = None;
        } else if at.saturating_sub(*self.away_since.get_or_insert(at)) > AWAY {
            self.found.get_or_insert(Implausible::ArmOffPath { joint, by_rad });
        }
    }

    /// Takes a report of the arm anywhere, with the target in it, and where it was sent last, rad.
    pub fn arm_target(
        &mut self,
        at: Duration,
        joints: &[f64; kinematics::ARM_JOINTS],
        target: Option<&[f64; kinematics::ARM_JOINTS]>,
        sent: &[f64; kinematics::ARM_JOINTS],
    ) {
        if let Some(foreign) = self.foreign.take(at, joints, target, sent) {
            self.found.get_or_insert(match foreign {
                Foreign::Target(joint, by_rad) => Implausible::ArmTargetForeign { joint, by_rad },
                Foreign::Place(joint, by_rad) => Implausible::ArmElsewhere { joint, by_rad },
            });
        }
    }

    /// The arm has come to the keyboard: what it reported before does not count.
    pub fn arm_has_arrived(&mut self) {
        (self.arm, self.arm_way, self.away_since) = (None, None, None);
        (self.arm_at, self.arm_sent_m, self.arm_speed) = (None, None, 0.0);
    }

    /// The first thing that is not plausible.
    pub fn found(&self) -> Option<&Implausible> {
        self.found.as_ref()
    }
}

#[cfg(test)]
mod tests;
