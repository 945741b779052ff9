//! Whether the arm is, or says that it was sent, where this program has not sent it: another client
//! of its controller sends it targets. The controller takes them from everybody, the newest counts,
//! and nobody hears of the others.
//!
//! An arm lags behind its targets, and so does its report: it is somewhere between the targets of
//! the last half second. It may ring or be shortened to a part of a path, which widens that range.
//! The thresholds are judgements: on the twin (`standard`, `worn` and drawn ones, sweeps at full
//! speed, replies with jitter, stalls) no joint was outside for more than two reports.

use std::collections::VecDeque;
use std::time::Duration;

use crate::xarm::kinematics::ARM_JOINTS;

/// Time after which a target does not explain any more where the arm is.
const LAG: Duration = Duration::from_millis(500);
/// How far a joint may be outside the range of its last targets, rad, and the share of that range
/// that may be added.
const OUTSIDE_RAD: f64 = 0.008;
const RINGS_SHARE: f64 = 0.3;
/// How long it must be outside, s; what is inside in between makes up for a quarter of its time.
const OUTSIDE_SECS: f64 = 0.2;
const FORGETS: f64 = 0.25;
/// The same for the target that the arm reports, which neither lags nor rings much.
const TARGET_OUTSIDE_RAD: f64 = 0.004;
const TARGET_SHARE: f64 = 0.1;
const TARGET_SECS: f64 = 0.015;
/// Reports whose targets are ours before one that is not means something: what older firmware
/// writes there is not known.
const TRUSTED: u32 = 10;
/// A longer time between two reports says nothing.
const MAX_SECS: f64 = 0.05;

type Joints = [f64; ARM_JOINTS];

/// What is not among our targets: a joint (from 1), and how far it is from them, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Foreign {
    /// The target that the arm reports.
    Target(usize, f64),
    /// Where the arm is.
    Place(usize, f64),
}

/// Compares the arm's reports with the targets of the last half second.
#[derive(Clone, Debug, Default)]
pub(super) struct ForeignTargets {
    sent: VecDeque<(Duration, Joints)>,
    at: Option<Duration>,
    /// Where the arm was when it was last among its targets.
    inside: Joints,
    outside_secs: f64,
    target_outside_secs: f64,
    trusted: u32,
}

impl ForeignTargets {
    /// Takes a report, with the target in it if it has one, and where the arm was sent last, rad.
    pub fn take(
        &mut self,
        at: Duration,
        joints: &Joints,
        target: Option<&Joints>,
        sent: &Joints,
    ) -> Option<Foreign> {
        let secs = at.saturating_sub(self.at.replace(at).unwrap_or(at)).as_secs_f64().min(MAX_SECS);
        // The target before them was in force when the half second began.
        while self.sent.get(1).is_some_and(|(sent_at, _)| at.saturating_sub(*sent_at) > LAG) {
            self.sent.pop_front();
        }
        self.sent.push_back((at, *sent));
        if let Some(target) = target {
            let (joint, by_rad) = self.outside(target, TARGET_SHARE);
            if by_rad <= TARGET_OUTSIDE_RAD {
                self.trusted = self.trusted.saturating_add(1);
                self.target_outside_secs = (self.target_outside_secs - secs * FORGETS * FORGETS).max(0.0);
            } else if self.trusted >= TRUSTED {
                self.target_outside_secs += secs;
            }
            if self.target_outside_secs > TARGET_SECS {
                return Some(Foreign::Target(joint, by_rad));
            }
        }
        let (joint, by_rad) = self.outside(joints, RINGS_SHARE);
        if by_rad <= OUTSIDE_RAD {
            self.inside = *joints;
            self.outside_secs = (self.outside_secs - secs * FORGETS).max(0.0);
        } else if self.inside != *joints {
            // Reports that repeat say nothing of where the arm is: another check looks at them.
            self.outside_secs += secs;
        }
        (self.outside_secs > OUTSIDE_SECS && by_rad > OUTSIDE_RAD).then_some(Foreign::Place(joint, by_rad))
    }

    /// The joint (from 1) that is farthest outside the range of its targets, widened by a share of
    /// it, and how far, rad.
    fn outside(&self, joints: &Joints, share: f64) -> (usize, f64) {
        let by = joints.iter().enumerate().map(|(joint, rad)| {
            let targets = self.sent.iter().map(|(_, sent)| sent[joint]);
            let [low, high] = targets.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], target| {
                [low.min(target), high.max(target)]
            });
            (joint + 1, (low - rad).max(rad - high) - share * (high - low))
        });
        by.fold((0, 0.0), |most, by| if by.1 > most.1 { by } else { most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is found within two seconds of `what(s)`: where joint 1 is, its reported target, and
    /// where it was sent.
    fn found(what: impl Fn(f64) -> (f64, Option<f64>, f64)) -> Option<(Duration, Foreign)> {
        let mut foreign = ForeignTargets::default();
        let joints = |rad: f64| {
            let mut joints = [0.1; ARM_JOINTS];
            joints[0] = rad;
            joints
        };
        (0..200u32).find_map(|report| {
            let at = Duration::from_millis(10) * report;
            let (rad, target, sent) = what(at.as_secs_f64());
            let target = target.map(joints);
            foreign.take(at, &joints(rad), target.as_ref(), &joints(sent)).map(|found| (at, found))
        })
    }

    fn wave(secs: f64) -> f64 {
        0.2 * (4.0 * secs.max(0.0)).sin()
    }

    #[test]
    fn an_arm_that_lags_rings_or_stands_is_where_it_was_sent() {
        assert_eq!(found(|secs| (1.15 * wave(secs - 0.25), None, wave(secs))), None);
        assert_eq!(found(|_| (0.005, None, 0.0)), None, "it sags");
        // A knock, and a held arm whose reports do not change.
        let knock = |secs: f64| if (1.0..1.15).contains(&secs) { 0.05 + 0.01 * secs } else { 0.0 };
        assert_eq!(found(|secs| (knock(secs), None, 0.0)), None);
        assert_eq!(found(|secs| (0.0, None, 0.1 * secs)), None);
    }

    #[test]
    fn an_arm_that_is_where_nobody_sent_it_is_found() {
        // Moved away while it is sent nowhere; pulled to and fro; kept back by half.
        let to = |secs: f64| (0.2 * (secs - 0.5)).clamp(0.0, 0.012) + 1e-5 * secs;
        let (at, away) = found(|secs| (to(secs), None, 0.0)).unwrap();
        assert!(matches!(away, Foreign::Place(1, _)) && at < Duration::from_millis(900));
        assert!(found(|secs| (0.05 * (9.0 * secs).sin(), None, 0.0)).is_some());
        assert!(found(|secs| (0.05 * secs.min(0.5) + 1e-5 * secs, None, 0.1 * secs.min(0.5))).is_some());
    }

    #[test]
    fn a_reported_target_that_is_not_ours_is_found_at_once_once_such_reports_are_known() {
        // Every tenth target that is reported is another client's.
        let foreign = |secs: f64| if (secs * 100.0).round() as u32 % 10 == 3 { 0.5 } else { 0.0 };
        let (at, found_in) = found(|secs| (0.0, Some(wave(secs - 0.1) + foreign(secs)), wave(secs))).unwrap();
        assert!(matches!(found_in, Foreign::Target(1, _)) && at < Duration::from_secs(1), "{at:?}");
        assert_eq!(found(|secs| (wave(secs - 0.1), Some(wave(secs - 0.05)), wave(secs))), None);
        assert_eq!(
            found(|secs| (wave(secs - 0.1), Some(7.0), wave(secs))),
            None,
            "another use of these bytes"
        );
    }
}
