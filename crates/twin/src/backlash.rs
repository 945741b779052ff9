//! Play between a motor and its joint: a torque that turns round has an effect only when the motor
//! has crossed the backlash.
//!
//! The motor is at one flank of the backlash and its torque passes to the joint, or it is on its
//! way and turns alone. It meets the other flank without a rebound; what it brings along is passed
//! on as one push. The joint keeps the motor's inertia and the dry friction while the motor
//! crosses, so a joint that is let go is heavier here than a real one.

use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams};

use crate::hidden_params::{HandParams, STEP};

/// Where a motor is in the backlash of its joint.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// At the flank in this direction, 1 or −1.
    Flank(f64),
    /// Between the flanks: how far ahead of the joint, rad, and how fast it turns, rad/s.
    Between(f64, f64),
}

/// The backlash of all joints.
pub(crate) struct Backlash {
    half: f64,
    armature: [f64; DRIVEN_JOINTS],
    places: [Place; DRIVEN_JOINTS],
}

impl Backlash {
    pub(crate) fn new(hand: &HandParams, params: &PhysicalParams) -> Self {
        Self {
            half: hand.motor_backlash_rad / 2.0,
            armature: std::array::from_fn(|joint| params.joint(JointRow::Armature, joint)),
            places: [Place::Flank(1.0); DRIVEN_JOINTS],
        }
    }

    /// The torque that reaches a joint that turns at `speed` (rad/s) in one [`STEP`], N·m. `motor`
    /// is the motor's torque at a speed.
    pub(crate) fn pass(&mut self, joint: usize, motor: impl Fn(f64) -> f64, speed: f64) -> f64 {
        let (ahead, turning) = match self.places[joint] {
            _ if self.half == 0.0 => return motor(speed),
            Place::Flank(side) => {
                let torque = motor(speed);
                if torque * side >= 0.0 {
                    return torque;
                }
                (side * self.half, speed)
            }
            Place::Between(ahead, turning) => (ahead, turning),
        };
        let secs = STEP.as_secs_f64();
        let turning = turning + motor(turning) / self.armature[joint] * secs;
        let ahead = ahead + (turning - speed) * secs;
        if ahead.abs() < self.half {
            self.places[joint] = Place::Between(ahead, turning);
            return 0.0;
        }
        self.places[joint] = Place::Flank(ahead.signum());
        self.armature[joint] * (turning - speed) / secs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const JOINT: usize = 5;

    fn with_backlash(motor_backlash_rad: f64) -> Backlash {
        let mut params = PhysicalParams::default();
        params.set("joint.all.armature", 0.001).unwrap();
        Backlash::new(&HandParams { motor_backlash_rad, ..HandParams::default() }, &params)
    }

    #[test]
    fn a_torque_that_turns_round_crosses_the_backlash_first() {
        let mut backlash = with_backlash(0.01);
        assert_eq!(backlash.pass(JOINT, |_| 0.1, 0.0), 0.1);
        // 0.01 rad at 100 rad/s² take 14.1 ms.
        let passed: Vec<f64> = (0..20).map(|_| backlash.pass(JOINT, |_| -0.1, 0.0)).collect();
        let met = passed.iter().position(|torque| *torque != 0.0).unwrap();
        assert!((13..=14).contains(&met), "{passed:?}");
        // The motor's momentum, and from then on its torque.
        let push = passed[met] * STEP.as_secs_f64();
        let momentum = -0.1 * 1e-3 * (met + 1) as f64;
        assert!((push - momentum).abs() < 1e-12, "{push} {momentum}");
        assert!(passed[met + 1..].iter().all(|torque| *torque == -0.1));
        // A torque in the same direction meets no backlash, whatever its size.
        assert_eq!(backlash.pass(JOINT, |_| -0.001, -0.3), -0.001);
    }

    #[test]
    fn a_motor_that_crosses_obeys_its_own_voltage() {
        let mut backlash = with_backlash(0.1);
        // The speed of a motor without load at this duty is 2 rad/s; its time constant is 10 ms.
        let motor = |speed: f64| -0.1 * (2.0 + speed) / 1.0;
        let met = (1..200).find(|_| backlash.pass(JOINT, motor, 0.0) != 0.0).unwrap();
        // 0.1 rad at 2 rad/s take 50 ms, and 10 ms are lost at the beginning.
        assert!((58..=62).contains(&met), "{met}");
    }

    #[test]
    fn without_backlash_every_torque_passes_at_once() {
        let mut backlash = with_backlash(0.0);
        for torque in [0.2, -0.3, 0.0, 0.1] {
            assert_eq!(backlash.pass(JOINT, |_| torque, 1.0), torque);
        }
    }

    proptest! {
        #[test]
        fn a_motor_stays_within_the_backlash(
            torques in prop::collection::vec(-0.5..0.5_f64, 1..200),
            speeds in prop::collection::vec(-5.0..5.0_f64, 200),
        ) {
            let mut backlash = with_backlash(0.02);
            for (torque, speed) in torques.iter().zip(speeds) {
                let passed = backlash.pass(JOINT, |_| *torque, speed);
                match backlash.places[JOINT] {
                    Place::Between(ahead, _) => prop_assert!(ahead.abs() < 0.01 && passed == 0.0),
                    Place::Flank(side) => prop_assert!(side.abs() == 1.0),
                }
            }
        }
    }
}
