//! How the emulated joints move: after servo targets, along planned moves, and to a stop.
//!
//! Time passes in steps of a millisecond, so that a motion does not depend on how often it is
//! looked at.

use std::collections::VecDeque;
use std::f64::consts::PI;

use etude_robot::xarm::kinematics::ARM_JOINTS;

/// Length of a step, s.
const STEP_SECS: f64 = 1e-3;
/// Fastest that a joint turns, rad/s (xArm user manual: 180 deg/s).
pub(super) const MAX_SPEED: f64 = PI;
/// Fastest that a joint's speed changes, rad/s² (xArm user manual: 1145 deg/s²).
const MAX_ACCELERATION: f64 = 1145.0 * PI / 180.0;
/// Targets that are on their way at most: a second of them.
const MAX_TARGETS: usize = 256;

type Joints = [f64; ARM_JOINTS];

/// The joints and what moves them.
#[derive(Debug)]
pub(super) struct JointMotion {
    pub(super) joints: Joints,
    speeds: Joints,
    drive: Drive,
    /// Servo targets that have not arrived at the joints yet, each with the step of its arrival.
    coming: VecDeque<(u64, Joints)>,
    bandwidth: f64,
    damping_ratio: Option<f64>,
    /// The joints are held by something.
    pub(super) stuck: bool,
}

#[derive(Clone, Copy, Debug)]
enum Drive {
    Follow(Joints),
    StraightMove(StraightMove),
    /// Each joint to its target on its own: target, speed, acceleration.
    Seek(Joints, f64, f64),
    /// Each joint at its speed.
    Turn(Joints),
}

/// Comes to a stop, and stands.
const REST: Drive = Drive::Turn([0.0; ARM_JOINTS]);

/// A move along a straight line in joint space, with a trapezoid of speed.
#[derive(Clone, Copy, Debug)]
struct StraightMove {
    from: Joints,
    to: Joints,
    /// Share of the way that is done, 0 to 1, and its rate.
    share: f64,
    rate: f64,
    /// Largest rate and change of rate, in shares.
    top: f64,
    slope: f64,
}

impl JointMotion {
    pub(super) fn new(joints: Joints, bandwidth_hz: f64, damping_ratio: Option<f64>) -> Self {
        let bandwidth = bandwidth_hz * 2.0 * PI;
        let (speeds, coming) = ([0.0; ARM_JOINTS], VecDeque::new());
        Self { joints, speeds, drive: REST, coming, bandwidth, damping_ratio, stuck: false }
    }

    /// Whether a joint moves or will.
    pub(super) fn moving(&self) -> bool {
        let due = match self.drive {
            Drive::Follow(target) => self.joints != target,
            Drive::StraightMove(_) | Drive::Seek(..) => true,
            Drive::Turn(speeds) => speeds != [0.0; ARM_JOINTS],
        };
        due || !self.coming.is_empty() || self.speeds != [0.0; ARM_JOINTS]
    }

    /// Whether a planned move is under way.
    pub(super) fn planned(&self) -> bool {
        matches!(self.drive, Drive::StraightMove(_) | Drive::Seek(..))
    }

    /// Speeds of the joints, rad/s.
    pub(super) fn speeds(&self) -> Joints {
        self.speeds
    }

    /// Where the arm is being sent, as far as is known.
    pub(super) fn aim(&self) -> Joints {
        match (self.coming.back(), self.drive) {
            (Some(&(_, target)), _) | (None, Drive::Follow(target)) => target,
            (None, Drive::StraightMove(plan)) => plan.to,
            (None, Drive::Seek(target, ..)) => target,
            (None, Drive::Turn(_)) => self.joints,
        }
    }

    /// The servo target that it follows now, or where it is.
    pub(super) fn target(&self) -> Joints {
        if let Drive::Follow(target) = self.drive { target } else { self.joints }
    }

    /// A servo target that arrives at this step.
    pub(super) fn follow(&mut self, at: u64, target: Joints) {
        if self.coming.len() == MAX_TARGETS {
            self.coming.pop_front();
        }
        self.coming.push_back((at, target));
    }

    /// Begins a planned move. Speed in rad/s and acceleration in rad/s² are those of the joint with
    /// the longest way.
    pub(super) fn plan(&mut self, to: Joints, speed: f64, acceleration: f64) {
        let longest = to.iter().zip(&self.joints).map(|(to, from)| (to - from).abs()).fold(1e-9, f64::max);
        let (top, slope) = (speed / longest, acceleration / longest);
        self.drive =
            Drive::StraightMove(StraightMove { from: self.joints, to, share: 0.0, rate: 0.0, top, slope });
    }

    /// Turns each joint to a target, as it moves now and in place of an earlier target: at most at
    /// this speed (rad/s), with this acceleration (rad/s²).
    pub(super) fn seek(&mut self, target: Joints, speed: f64, acceleration: f64) {
        self.drive = Drive::Seek(target, speed, acceleration.min(MAX_ACCELERATION));
    }

    /// Turns each joint at a speed (rad/s) until something else is ordered.
    pub(super) fn turn_at(&mut self, speeds: Joints) {
        self.drive = Drive::Turn(speeds);
    }

    /// Drops every target and comes to a stop.
    pub(super) fn brake(&mut self) {
        self.coming.clear();
        self.drive = REST;
    }

    /// Moves the arm by hand to these joints.
    pub(super) fn place(&mut self, joints: Joints) {
        (self.joints, self.speeds, self.drive) = (joints, [0.0; ARM_JOINTS], REST);
        self.coming.clear();
    }

    /// One millisecond: the one numbered `now`. A paused arm slows down along its way.
    pub(super) fn step(&mut self, now: u64, paused: bool) {
        while let Some((_, target)) = self.coming.pop_front_if(|(at, _)| *at <= now) {
            self.drive = Drive::Follow(target);
        }
        if self.stuck {
            self.speeds = [0.0; ARM_JOINTS];
            return;
        }
        let (bandwidth, damping_ratio) = (self.bandwidth, self.damping_ratio);
        match self.drive {
            Drive::StraightMove(mut plan) => {
                let before = std::mem::replace(&mut self.joints, plan.step(paused));
                let ended = plan.share >= 1.0;
                self.drive = if ended { REST } else { Drive::StraightMove(plan) };
                let speed = |joint: usize| (self.joints[joint] - before[joint]) / STEP_SECS;
                self.speeds = std::array::from_fn(|joint| if ended { 0.0 } else { speed(joint) });
            }
            Drive::Follow(target) => {
                self.turn_to(&target, MAX_ACCELERATION, |apart, speed| match damping_ratio {
                    // As fast as allowed, but so that it can still stop at the target.
                    None => {
                        let stoppable = (2.0 * MAX_ACCELERATION * apart.abs()).sqrt().min(MAX_SPEED);
                        (bandwidth * apart).clamp(-stoppable, stoppable)
                    }
                    // A mass on a spring.
                    Some(ratio) => {
                        let pull = bandwidth * apart - 2.0 * ratio * speed;
                        (speed + bandwidth * pull * STEP_SECS).clamp(-MAX_SPEED, MAX_SPEED)
                    }
                })
            }
            Drive::Seek(target, most, acceleration) => {
                let most = if paused { 0.0 } else { most };
                // Slower near the target than the acceleration would allow, so that it does not
                // pass it.
                self.turn_to(&target, acceleration, |apart, _| {
                    let stoppable = (acceleration * apart.abs()).sqrt();
                    (bandwidth * apart.abs()).min(stoppable).min(most).copysign(apart)
                });
                if self.joints == target {
                    self.drive = REST;
                }
            }
            Drive::Turn(speeds) => {
                for (joint, speed) in speeds.into_iter().enumerate() {
                    self.turn(joint, if paused { 0.0 } else { speed }, MAX_ACCELERATION);
                }
            }
        }
    }

    /// Turns each joint for a step, at the speed that is wanted so far from its target and at its
    /// speed.
    fn turn_to(&mut self, target: &Joints, acceleration: f64, wanted: impl Fn(f64, f64) -> f64) {
        for (joint, &to) in target.iter().enumerate() {
            let apart = to - self.joints[joint];
            self.turn(joint, wanted(apart, self.speeds[joint]), acceleration);
            if apart.abs() < 1e-6 && self.speeds[joint].abs() < 1e-3 {
                (self.joints[joint], self.speeds[joint]) = (to, 0.0);
            }
        }
    }

    /// Turns one joint for a step, with its speed as near to `wanted` as its acceleration allows.
    fn turn(&mut self, joint: usize, wanted: f64, acceleration: f64) {
        let change = acceleration * STEP_SECS;
        let speed = &mut self.speeds[joint];
        *speed += (wanted - *speed).clamp(-change, change);
        self.joints[joint] += *speed * STEP_SECS;
    }
}

impl StraightMove {
    fn step(&mut self, paused: bool) -> Joints {
        let (change, left) = (self.slope * STEP_SECS, 1.0 - self.share);
        let top = if paused { 0.0 } else { self.top.min((2.0 * self.slope * left).sqrt()) };
        self.rate = top.clamp((self.rate - change).max(0.0), self.rate + change);
        self.share += self.rate * STEP_SECS;
        if 1.0 - self.share <= change * STEP_SECS {
            self.share = 1.0;
            return self.to;
        }
        std::array::from_fn(|joint| self.from[joint] + (self.to[joint] - self.from[joint]) * self.share)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_planned_move_arrives_in_the_time_of_its_trapezoid() {
        let mut motion = JointMotion::new([0.0; ARM_JOINTS], 8.0, None);
        let to = [1.0, -0.5, 0.0, 0.3, 0.0, 0.0, 0.2];
        motion.plan(to, 0.5, 2.0);
        let steps = (1..10_000).find(|&step| {
            motion.step(step, false);
            !motion.planned()
        });
        // 1 rad at 0.5 rad/s, and 0.25 s for each of both ramps of half the speed.
        assert!((2200..2320).contains(&steps.unwrap()), "{steps:?}");
        assert_eq!(motion.joints, to);
        assert!(!motion.moving());
    }

    #[test]
    fn it_holds_at_the_last_target() {
        let mut motion = JointMotion::new([0.0; ARM_JOINTS], 8.0, None);
        motion.follow(20, [0.3; ARM_JOINTS]);
        (0..20).for_each(|step| motion.step(step, false));
        assert_eq!(motion.joints, [0.0; ARM_JOINTS]);
        (20..3000).for_each(|step| motion.step(step, false));
        assert_eq!((motion.joints, motion.moving()), ([0.3; ARM_JOINTS], false));
    }

    /// A small step, and a steady ramp: the textbook's overshoot and lag of a system of second
    /// order.
    #[test]
    fn an_arm_with_a_damping_ratio_overshoots_and_lags_as_its_numbers_say() {
        for (hertz, ratio) in [(5.0, 0.5), (8.0, 0.7), (4.0, 0.8)] {
            let mut motion = JointMotion::new([0.0; ARM_JOINTS], hertz, Some(ratio));
            motion.follow(0, [1e-3; ARM_JOINTS]);
            let farthest = (0..1000).fold(0.0_f64, |most, step| {
                motion.step(step, false);
                most.max(motion.joints[3])
            });
            let overshoot = (-ratio * PI / (1.0 - ratio * ratio).sqrt()).exp();
            assert!((farthest / 1e-3 - 1.0 - overshoot).abs() < 0.02, "{hertz} Hz, {ratio}: {farthest}");
            assert_eq!(motion.joints, [1e-3; ARM_JOINTS], "it comes to rest");

            let mut motion = JointMotion::new([0.0; ARM_JOINTS], hertz, Some(ratio));
            let speed = 0.4;
            for step in 0..1500 {
                motion.follow(step, [speed * step as f64 * STEP_SECS; ARM_JOINTS]);
                motion.step(step, false);
            }
            let lag = (speed * 1499.0 * STEP_SECS - motion.joints[0]) / speed;
            let expected = 2.0 * ratio / (2.0 * PI * hertz);
            assert!((lag - expected).abs() < 1.5e-3, "{hertz} Hz, {ratio}: {lag} s, not {expected}");
        }
    }

    proptest! {
        #[test]
        fn speed_and_acceleration_stay_within_the_arms(
            targets in prop::collection::vec(prop::array::uniform7(-2.0..2.0), 1..20),
            stop_after in 1..2000_u64,
            ratio in prop::option::of(0.3..1.5),
        ) {
            let mut motion = JointMotion::new([0.0; ARM_JOINTS], 8.0, ratio);
            for (index, target) in targets.iter().enumerate() {
                motion.follow(index as u64 * 50, *target);
            }
            let (mut before, mut speeds) = (motion.joints, [0.0; ARM_JOINTS]);
            for step in 0..3000 {
                if step == stop_after {
                    motion.brake();
                }
                motion.step(step, false);
                for joint in 0..ARM_JOINTS {
                    let speed = (motion.joints[joint] - before[joint]) / STEP_SECS;
                    prop_assert!(speed.abs() <= MAX_SPEED + 1e-9);
                    let change = (speed - speeds[joint]).abs() / STEP_SECS;
                    prop_assert!(change <= MAX_ACCELERATION + 2.0, "{change}");
                    speeds[joint] = speed;
                }
                before = motion.joints;
            }
            prop_assert!(!motion.moving());
        }
    }
}
