//! The arm's path between two places away from the keyboard, straight in joint space, as targets of
//! the servo mode.
//!
//! A planned move of the arm's controller would continue without us to its end. A servo target ends
//! in place: if this program is killed, the arm stands a few millimetres later.

use std::time::Duration;

use crate::limiter::{Axis, AxisLimits};
use crate::xarm::kinematics::ARM_JOINTS;
use crate::xarm::{ArmConfig, ArmFault, flange_positions, largest_turn};

/// Greatest speed of a joint, rad/s: a tenth of what it may do.
const MAX_SPEED: f64 = 0.3;
/// Greatest acceleration and jerk of a joint, rad/s² and rad/s³: full speed after 0.4 s.
const MAX_ACCELERATION: f64 = 1.0;
const MAX_JERK: f64 = 10.0;
/// Share of the flange's speed limit that is used.
const FLANGE_SHARE: f64 = 0.5;
/// The arm has arrived when every joint is this near, rad.
const ARRIVED_RAD: f64 = 0.02;
/// Longest time from the last target to the arrival.
const ARRIVAL_TIMEOUT: Duration = Duration::from_secs(2);
/// How many times as long as planned a path may take, and how much longer besides, if the replies
/// come late.
const MAX_SLOWDOWN: u32 = 3;
const SLOWDOWN_ROOM: Duration = Duration::from_secs(3);
/// Turn that counts as none, rad.
const NONE_RAD: f64 = 1e-6;

/// The path to a via point.
#[derive(Clone, Debug)]
pub(super) struct ArmPath {
    from: [f64; ARM_JOINTS],
    to: [f64; ARM_JOINTS],
    /// How far the joint that turns most turns, rad.
    turn: f64,
    /// How far it has turned: one step for each target that is sent.
    along: Axis,
    /// When the first target was sent, and how long all of them take on a good link.
    begun: Option<Duration>,
    planned: Duration,
    sent_all_at: Option<Duration>,
}

impl ArmPath {
    /// From rest at `from` to rest at `to` (rad), with a target every `period`.
    pub fn new(from: [f64; ARM_JOINTS], to: [f64; ARM_JOINTS], config: &ArmConfig, period: Duration) -> Self {
        let (_, turn) = largest_turn(&from, &to);
        let velocity = MAX_SPEED
            .min(config.joint_speed_limit_rad_s)
            .min(FLANGE_SHARE * config.tcp_speed_limit_m_s / flange_m_per_rad(&from, &to, turn));
        let limits =
            AxisLimits { position: [0.0, turn], velocity, acceleration: MAX_ACCELERATION, jerk: MAX_JERK };
        let along = Axis::at_rest(limits, period.as_secs_f64(), 0.0);
        // Constant speed, and a ramp at either end.
        let ramp_secs = velocity / MAX_ACCELERATION + MAX_ACCELERATION / MAX_JERK;
        let planned = Duration::from_secs_f64(turn / velocity + ramp_secs);
        Self { from, to, turn, along, begun: None, planned, sent_all_at: None }
    }

    /// The next target, one `period` of the motion after the last. After a pause the path continues
    /// from rest.
    pub fn next(&mut self, now: Duration, paused: bool, period: Duration) -> [f64; ARM_JOINTS] {
        self.begun.get_or_insert(now);
        self.along.pause(if paused { f64::INFINITY } else { 0.0 }, period.as_secs_f64());
        self.along.step(self.turn);
        if self.turn - self.along.position() <= NONE_RAD {
            self.sent_all_at.get_or_insert(now);
            return self.to;
        }
        between(&self.from, &self.to, self.along.position() / self.turn)
    }

    /// Whether the path takes so much longer than planned that the robot is stopped.
    pub fn is_late(&self, now: Duration) -> bool {
        let took = self.begun.map_or(Duration::ZERO, |begun| now.saturating_sub(begun));
        self.sent_all_at.is_none() && took > self.planned * MAX_SLOWDOWN + SLOWDOWN_ROOM
    }

    /// Whether the arm, which is at `joints` (rad), has arrived.
    ///
    /// # Errors
    /// If it should have arrived long ago.
    pub fn has_arrived(&self, now: Duration, joints: &[f64; ARM_JOINTS]) -> Result<bool, ArmFault> {
        let Some(sent) = self.sent_all_at else { return Ok(false) };
        let (joint, by_rad) = largest_turn(joints, &self.to);
        if by_rad <= ARRIVED_RAD {
            return Ok(true);
        }
        let late = now.saturating_sub(sent) > ARRIVAL_TIMEOUT;
        if late { Err(ArmFault::NotFollowing { joint, by_rad }) } else { Ok(false) }
    }
}

/// The place at a share of the path.
fn between(from: &[f64; ARM_JOINTS], to: &[f64; ARM_JOINTS], share: f64) -> [f64; ARM_JOINTS] {
    std::array::from_fn(|joint| from[joint] + (to[joint] - from[joint]) * share)
}

/// The longest path of the flange for one rad of the joint that turns most, m.
fn flange_m_per_rad(from: &[f64; ARM_JOINTS], to: &[f64; ARM_JOINTS], turn: f64) -> f64 {
    let places: Vec<_> = flange_positions(from, to).collect();
    let longest = places.windows(2).map(|pair| (pair[1] - pair[0]).norm()).fold(0.0, f64::max);
    (longest * (places.len() - 1) as f64 / turn.max(NONE_RAD)).max(NONE_RAD)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::xarm::kinematics::{self, PAPER_HOME_DEG};

    proptest! {
        #![proptest_config(ProptestConfig { cases: 60, ..Default::default() })]
        /// Whatever pauses: joints and flange stay within their limits from target to target, and
        /// the path ends where it should.
        #[test]
        fn a_path_keeps_its_limits_and_ends(
            turns in prop::array::uniform7(-1.0..1.0_f64),
            tcp_speed_limit_m_s in 0.05..1.0_f64,
            pauses in prop::collection::vec((0..4000_usize, 4.0..20.0_f64), 0..6),
            period_ms in 4.0..20.0_f64,
        ) {
            let config = ArmConfig { tcp_speed_limit_m_s, ..ArmConfig::default() };
            let from = PAPER_HOME_DEG.map(f64::to_radians);
            let to = std::array::from_fn(|joint| from[joint] + turns[joint]);
            let mut secs = period_ms / 1e3;
            let mut path = ArmPath::new(from, to, &config, Duration::from_secs_f64(secs));
            let (mut before, mut speed) = (from, 0.0);
            let mut targets = 0;
            while path.sent_all_at.is_none() {
                // The period changes only after a pause.
                let pause = pauses.iter().find(|(at, _)| *at == targets);
                secs = pause.map_or(secs, |(_, ms)| ms / 1e3);
                let paused = pause.is_some();
                let next = path.next(Duration::ZERO, paused, Duration::from_secs_f64(secs));
                let (_, turn) = largest_turn(&before, &next);
                let flange = (kinematics::forward(&next).position_m - kinematics::forward(&before).position_m).norm();
                prop_assert!(turn / secs <= MAX_SPEED * 1.001 && flange / secs <= 0.51 * tcp_speed_limit_m_s);
                speed = if paused { 0.0 } else { speed };
                prop_assert!((turn / secs - speed).abs() / secs <= MAX_ACCELERATION * 1.001 + 1e-4);
                (before, speed) = (next, turn / secs);
                targets += 1;
                prop_assert!(targets < 40_000);
            }
            prop_assert_eq!(before, to);
        }
    }

    #[test]
    fn an_arm_that_does_not_arrive_is_a_fault() {
        let from = PAPER_HOME_DEG.map(f64::to_radians);
        let mut to = from;
        to[3] += 0.3;
        let period = ArmConfig::default().servo_period();
        let mut path = ArmPath::new(from, to, &ArmConfig::default(), period);
        assert_eq!(path.has_arrived(Duration::ZERO, &to), Ok(false), "not all was sent");
        while path.sent_all_at.is_none() {
            path.next(Duration::from_secs(3), false, period);
        }
        let mut near = to;
        near[3] -= 0.03;
        assert_eq!(path.has_arrived(Duration::from_secs(4), &near), Ok(false));
        let late = path.has_arrived(Duration::from_secs(6), &near);
        assert!(matches!(late, Err(ArmFault::NotFollowing { joint: 4, .. })), "{late:?}");
        assert_eq!(path.has_arrived(Duration::from_secs(6), &to), Ok(true));
        // A path of no length is over with its first target.
        let mut none = ArmPath::new(to, to, &ArmConfig::default(), period);
        assert_eq!(none.next(Duration::ZERO, false, period), to);
        assert_eq!(none.has_arrived(Duration::ZERO, &to), Ok(true));
    }
}
