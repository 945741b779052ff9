//! The controller of one joint: low-pass, bounded-jerk reference, delay, PD, torque clamp, dead
//! band.
//!
//! The paper drives every simulated joint by "a PD controller with maximum jerk, a low pass filter
//! and damping", tuned for each joint. Ours runs at each physics step, outside MuJoCo's model,
//! which has plain torque actuators.
//!
//! ```text
//! target ─► low-pass ─► reference (velocity, acceleration, jerk bounded) ─► delay
//!        ─► PD ─► clamp ─► dead band ─► torque
//! ```
//!
//! The *reference* is what the queue of the delay takes, the *set-point* what leaves it: the PD
//! follows the set-point. Methods named `step…` advance the controller by one physics step.
//!
//! The delay is last because the reference is smooth, unlike the targets: it can be interpolated
//! between two physics steps, so that a fit of the delay has gradients. For delays of whole steps
//! the order makes no difference.

use serde::{Deserialize, Serialize};

use crate::params::{JointRow, PhysicalParams};

/// How joints are driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Actuation {
    /// The paper's main text: low-pass, bounded jerk, PD, torque clamp.
    #[default]
    Controlled,
    /// The paper's appendix: a position actuator (torque proportional to the error) and damping in
    /// the joint, without filter, reference or clamp.
    Position,
}

/// Longest delay, in physics steps, that the command queue holds.
const QUEUE: usize = 32;

/// Constants of one controller, computed from [`PhysicalParams`] and the physics step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControllerConstants {
    step_secs: f64,
    stiffness: f64,
    damping: f64,
    torque_limit: f64,
    dead_band: f64,
    smoothing: f64,
    velocity_limit: f64,
    acceleration_limit: f64,
    jerk_limit: f64,
    approach: f64,
    settle_secs: f64,
    /// The delay in physics steps: whole ones, and the rest.
    delay: (usize, f64),
    encoder_bias: f64,
    actuation: Actuation,
}

impl ControllerConstants {
    /// The constants of joint `index` for a physics step of `step_secs`.
    pub fn new(params: &PhysicalParams, index: usize, actuation: Actuation, step_secs: f64) -> Self {
        let value = |quantity| params.joint(quantity, index);
        let (acceleration_limit, jerk_limit) =
            (value(JointRow::AccelerationLimit), value(JointRow::JerkLimit));
        // Near the target the reference is a critically damped third-order system whose fastest
        // part takes as long as the jerk limit needs to build up the full acceleration.
        let settle_secs = (acceleration_limit / jerk_limit).max(step_secs);
        let delay_steps = value(JointRow::Delay) / step_secs;
        // The small number makes up for rounding: 0.03 / 0.005 is less than 6 in floating point.
        let whole = (delay_steps + 1e-9) as usize;
        Self {
            step_secs,
            stiffness: value(JointRow::Stiffness),
            damping: value(JointRow::Damping),
            torque_limit: value(JointRow::TorqueLimit),
            dead_band: value(JointRow::DeadBand),
            smoothing: 1.0 - (-step_secs / value(JointRow::LowPass).max(1e-9)).exp(),
            velocity_limit: value(JointRow::VelocityLimit),
            acceleration_limit,
            jerk_limit,
            approach: 1.0 / (4.0 * settle_secs),
            settle_secs,
            delay: (whole.min(QUEUE - 2), (delay_steps - whole as f64).max(0.0)),
            encoder_bias: value(JointRow::EncoderBias),
            actuation,
        }
    }

    /// The PD law: torque toward `set_point`, beyond the dead band.
    fn pd_torque(&self, set_point: f64, measured: f64, velocity: f64) -> f64 {
        let torque = match self.actuation {
            Actuation::Position => self.stiffness * (set_point - measured),
            Actuation::Controlled => {
                let torque = self.stiffness * (set_point - measured) - self.damping * velocity;
                torque.clamp(-self.torque_limit, self.torque_limit)
            }
        };
        if self.dead_band == 0.0 {
            return torque;
        }
        torque - torque.clamp(-self.dead_band, self.dead_band)
    }

    /// Encoder reading of a joint at the true `position`.
    pub fn measured(&self, position: f64) -> f64 {
        position + self.encoder_bias
    }
}

/// State of one joint's controller. Positions are encoder readings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Controller {
    queue: Vec<f64>,
    head: usize,
    filtered: f64,
    position: f64,
    velocity: f64,
    acceleration: f64,
}

impl Controller {
    /// At rest at `position`, which is also its target.
    pub fn at_rest(position: f64) -> Self {
        let mut controller = Self { queue: vec![0.0; QUEUE], ..Self::default() };
        controller.reset_to_rest(position);
        controller
    }

    /// Back to rest at `position`, without allocating.
    pub fn reset_to_rest(&mut self, position: f64) {
        self.queue.fill(position);
        self.head = 0;
        self.filtered = position;
        self.position = position;
        self.velocity = 0.0;
        self.acceleration = 0.0;
    }

    /// Continues from a reference at `position` that moves at `velocity`: something else has moved
    /// it.
    pub fn resume(&mut self, position: f64, velocity: f64) {
        (self.position, self.velocity, self.acceleration) = (position, velocity, 0.0);
    }

    /// The reference now.
    pub fn reference(&self) -> f64 {
        self.queue[self.head]
    }

    /// How far the reference moves in the next physics step toward `target`, and where it stops if
    /// it brakes after that.
    pub(crate) fn next_stop(&self, constants: &ControllerConstants, target: f64) -> [f64; 2] {
        let [position, velocity, _] = self.advanced(constants, self.low_passed(constants, target));
        [position - self.position, stop(constants, position, velocity)]
    }

    /// Velocity of the reference.
    pub(crate) fn velocity(&self) -> f64 {
        self.velocity
    }

    /// One physics step as [`step`](Self::step) in which the reference brakes.
    pub(crate) fn step_braking(
        &mut self,
        constants: &ControllerConstants,
        target: f64,
        measured: f64,
        velocity: f64,
    ) -> f64 {
        self.filtered = self.low_passed(constants, target);
        self.advance(constants, stop(constants, self.position, self.velocity));
        let set_point = self.delayed(constants, self.position);
        constants.pd_torque(set_point, measured, velocity)
    }

    /// Whether a deserialised controller is consistent.
    pub(crate) fn is_sound(&self) -> bool {
        self.queue.len() == QUEUE && self.head < QUEUE
    }

    /// One physics step: the torque for `target` when the encoder reads `measured` and the joint
    /// moves at `velocity`.
    pub fn step(
        &mut self,
        constants: &ControllerConstants,
        target: f64,
        measured: f64,
        velocity: f64,
    ) -> f64 {
        let set_point = self.step_set_point(constants, target);
        constants.pd_torque(set_point, measured, velocity)
    }

    /// One physics step as [`step`](Self::step) with this `reference`, without low-pass and limits:
    /// for references that were shaped already.
    pub fn step_tracking(
        &mut self,
        constants: &ControllerConstants,
        reference: f64,
        measured: f64,
        velocity: f64,
    ) -> f64 {
        let set_point = self.delayed(constants, reference);
        constants.pd_torque(set_point, measured, velocity)
    }

    /// One physics step without a torque: the set-point for `target`, for a robot whose own drives
    /// follow set-points.
    pub fn step_set_point(&mut self, constants: &ControllerConstants, target: f64) -> f64 {
        let reference = match constants.actuation {
            Actuation::Position => target,
            Actuation::Controlled => {
                self.filtered = self.low_passed(constants, target);
                self.advance(constants, self.filtered);
                self.position
            }
        };
        self.delayed(constants, reference)
    }

    /// The target after the low-pass, in this physics step.
    fn low_passed(&self, constants: &ControllerConstants, target: f64) -> f64 {
        self.filtered + constants.smoothing * (target - self.filtered)
    }

    /// The set-point after this `reference`, interpolated linearly between two physics steps.
    fn delayed(&mut self, constants: &ControllerConstants, reference: f64) -> f64 {
        self.head = (self.head + 1) % QUEUE;
        self.queue[self.head] = reference;
        let (whole, rest) = constants.delay;
        let ago = |steps: usize| self.queue[(self.head + QUEUE - steps) % QUEUE];
        ago(whole) + rest * (ago(whole + 1) - ago(whole))
    }

    /// Moves the reference one step toward `goal` within its limits.
    fn advance(&mut self, constants: &ControllerConstants, goal: f64) {
        [self.position, self.velocity, self.acceleration] = self.advanced(constants, goal);
    }

    /// Position, velocity and acceleration of the reference one step nearer to `goal`.
    fn advanced(&self, constants: &ControllerConstants, goal: f64) -> [f64; 3] {
        let dt = constants.step_secs;
        let error = goal - self.position;
        // Far away: the speed from which half the acceleration limit still stops in time; the other
        // half is a reserve for the jerk limit. Close by: proportional, so that it settles without
        // overshoot.
        let stoppable = (constants.acceleration_limit * error.abs()).sqrt();
        let speed = (constants.approach * error.abs()).min(stoppable).min(constants.velocity_limit);
        let desired = (speed.copysign(error) - self.velocity) / constants.settle_secs;
        let desired = desired.clamp(-constants.acceleration_limit, constants.acceleration_limit);
        let max_change = constants.jerk_limit * dt;
        let change = (desired - self.acceleration).clamp(-max_change, max_change);
        let acceleration = self.acceleration + change;
        let velocity = self.velocity + acceleration * dt;
        let limited = velocity.clamp(-constants.velocity_limit, constants.velocity_limit);
        [self.position + limited * dt, limited, acceleration]
    }
}

/// Where a reference at `position` stops if it brakes now.
fn stop(constants: &ControllerConstants, position: f64, velocity: f64) -> f64 {
    position + velocity * velocity.abs() / (2.0 * constants.acceleration_limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hand::{DRIVEN_JOINTS, RAIL};
    use proptest::prelude::*;

    const STEP: f64 = 0.005;

    fn constants(index: usize) -> ControllerConstants {
        ControllerConstants::new(&PhysicalParams::default(), index, Actuation::Controlled, STEP)
    }

    proptest! {
        #[test]
        fn the_reference_keeps_its_limits(
            index in 0..DRIVEN_JOINTS,
            targets in prop::collection::vec(-1.5f64..1.5, 1..12),
        ) {
            let constants = constants(index);
            let mut controller = Controller::at_rest(0.0);
            let mut previous = [0.0; 3];
            for target in targets.iter().flat_map(|t| std::iter::repeat_n(*t, 10)) {
                let torque = controller.step(&constants, target, 0.0, 0.0);
                prop_assert!(torque.abs() <= constants.torque_limit);
                let now = [controller.position, controller.velocity, controller.acceleration];
                let slack = 1.0 + 1e-9;
                prop_assert!(now[1].abs() <= constants.velocity_limit * slack);
                prop_assert!(now[2].abs() <= constants.acceleration_limit * slack);
                prop_assert!((now[2] - previous[2]).abs() <= constants.jerk_limit * STEP * slack);
                prop_assert!((now[0] - previous[0] - now[1] * STEP).abs() < 1e-12);
                previous = now;
            }
        }

        #[test]
        fn the_reference_arrives_and_stays(index in 0..DRIVEN_JOINTS, target in -0.3f64..0.3) {
            let constants = constants(index);
            let mut controller = Controller::at_rest(0.0);
            let mut furthest: f64 = 0.0;
            for _ in 0..600 {
                controller.step(&constants, target, 0.0, 0.0);
                furthest = furthest.max(controller.position * target.signum());
            }
            prop_assert!((controller.position - target).abs() < 1e-4);
            prop_assert!(furthest <= target.abs() * 1.05 + 1e-6, "overshoot to {furthest} for {target}");
        }
    }

    #[test]
    fn a_delay_puts_a_target_off_by_steps_and_parts_of_them() {
        let set_points = |delay: f64| -> Vec<f64> {
            let mut params = PhysicalParams::default();
            params.set("joint.rail.delay", delay).unwrap();
            let constants = ControllerConstants::new(&params, RAIL, Actuation::Position, STEP);
            let mut controller = Controller::at_rest(0.0);
            (0..6).map(|_| controller.step_set_point(&constants, 1.0)).collect()
        };
        for whole in 0..=20u8 {
            // As 0.03 / 0.005, which is not 6 to a computer.
            let delayed = set_points(f64::from(whole) * STEP);
            assert_eq!(delayed, [0, 1, 2, 3, 4, 5].map(|step| f64::from(u8::from(step >= whole))));
        }
        let quarter = set_points(0.01 + 0.25 * STEP);
        assert!(quarter.iter().zip([0.0, 0.0, 0.75, 1.0, 1.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-9));
    }

    #[test]
    fn a_reference_that_is_tracked_is_not_shaped_again() {
        let mut params = PhysicalParams::default();
        params.set("joint.index_1.delay", 0.01).unwrap();
        let constants = ControllerConstants::new(&params, 1, Actuation::Controlled, STEP);
        let mut controller = Controller::at_rest(0.0);
        let torques: Vec<f64> =
            (0..4).map(|_| controller.step_tracking(&constants, 0.1, 0.02, 0.5)).collect();
        let law = |set_point: f64| 3.0 * (set_point - 0.02) - 0.1 * 0.5;
        assert_eq!(torques, [law(0.0), law(0.0), law(0.1), law(0.1)]);
    }

    #[test]
    fn a_motor_moves_nothing_within_its_dead_band() {
        for actuation in [Actuation::Controlled, Actuation::Position] {
            let torque = |dead_band: f64, reference: f64| {
                let mut params = PhysicalParams::default();
                params.set("joint.index_1.dead_band", dead_band).unwrap();
                let constants = ControllerConstants::new(&params, 1, actuation, STEP);
                Controller::at_rest(0.0).step_tracking(&constants, reference, 0.0, 0.0)
            };
            for reference in [-0.1, -0.003, 0.0, 0.003, 0.1] {
                let (with, without) = (torque(0.012, reference), torque(0.0, reference));
                let expected = (without.abs() - 0.012).max(0.0) * without.signum();
                assert!((with - expected).abs() < 1e-15, "{actuation:?} {reference}: {with}, {expected}");
            }
        }
        // What the clamp leaves of a torque loses the dead band.
        let mut params = PhysicalParams::default();
        params.set("joint.index_1.dead_band", 0.0125).unwrap();
        let constants = ControllerConstants::new(&params, 1, Actuation::Controlled, STEP);
        assert_eq!(Controller::at_rest(0.0).step_tracking(&constants, 1.0, 0.0, 0.0), 0.55);
    }

    #[test]
    fn a_step_of_one_white_key_takes_what_the_limits_say() {
        let constants = constants(RAIL);
        let mut controller = Controller::at_rest(0.0);
        let distance = crate::geometry::WHITE_PITCH;
        let steps = (1..400).find(|_| {
            controller.step(&constants, distance, 0.0, 0.0);
            (controller.position - distance).abs() < 0.1 * distance
        });
        let fastest = (32.0 * distance / constants.jerk_limit).cbrt();
        let secs = steps.expect("it arrives") as f64 * STEP;
        assert!(secs > 0.6 * fastest && secs < 4.0 * fastest, "{secs} s, ideal {fastest} s");
    }
}
