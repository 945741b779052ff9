//! Sixteen independent joints without weight or contact: enough to run the emulator without a
//! physics engine.

use etude_robot::allegro::{FULL_SCALE_PWM, JOINT_LIMITS_RAD, WIRE_JOINTS};

/// Inertia at a joint, duty / (rad/s²). With the default gains a joint is damped a little more than
/// critically.
const INERTIA: f64 = 0.002;
/// Damping at a joint, duty / (rad/s): the strongest joint at its limit of 0.5625 runs 7 rad/s
/// (URDF in allegro_hand_ros2).
const DAMPING: f64 = 0.08;
/// Longest step of the integration, s.
const STEP_SECS: f64 = 0.0005;

/// Free joints between their stops.
#[derive(Clone, Debug)]
pub struct FreeHand {
    positions: [f64; WIRE_JOINTS],
    velocities: [f64; WIRE_JOINTS],
}

impl Default for FreeHand {
    /// At rest, all joints at the angle nearest to 0 within their limits.
    fn default() -> Self {
        Self {
            positions: JOINT_LIMITS_RAD.map(|[lower, upper]| 0.0f64.clamp(lower, upper)),
            velocities: [0.0; WIRE_JOINTS],
        }
    }
}

impl FreeHand {
    /// Moves on by `secs` (at most one second at a time) under the PWM of each flat joint.
    pub fn step(&mut self, secs: f64, pwm: &[i16; WIRE_JOINTS]) {
        let secs = if secs.is_finite() { secs.clamp(0.0, 1.0) } else { 0.0 };
        let steps = (secs / STEP_SECS).ceil();
        let dt = if steps > 0.0 { secs / steps } else { 0.0 };
        let joints = self.positions.iter_mut().zip(&mut self.velocities).zip(pwm).zip(JOINT_LIMITS_RAD);
        for (((position, velocity), &pwm), [lower, upper]) in joints {
            let duty = f64::from(pwm) / f64::from(FULL_SCALE_PWM);
            for _ in 0..steps as u32 {
                *velocity += dt / INERTIA * (duty - DAMPING * *velocity);
                let free = *position + dt * *velocity;
                *position = free.clamp(lower, upper);
                if *position != free {
                    *velocity = 0.0;
                }
            }
        }
    }

    /// Angle of each flat joint, rad.
    pub fn positions(&self) -> [f64; WIRE_JOINTS] {
        self.positions
    }

    /// Puts the joints at rest at these angles, cut to their limits; what is not a number leaves a
    /// joint where it is.
    pub fn set_positions(&mut self, positions: &[f64; WIRE_JOINTS]) {
        for ((mine, &wanted), [lower, upper]) in
            self.positions.iter_mut().zip(positions).zip(JOINT_LIMITS_RAD)
        {
            if !wanted.is_nan() {
                *mine = wanted.clamp(lower, upper);
            }
        }
        self.velocities = [0.0; WIRE_JOINTS];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_torque_runs_at_the_stated_speed_into_the_stop() {
        let mut hand = FreeHand::default();
        let mut pwm = [0; WIRE_JOINTS];
        pwm[1] = 675;
        hand.step(0.2, &pwm);
        assert!((hand.velocities[1] - 7.03).abs() < 0.1, "{}", hand.velocities[1]);
        hand.step(1.0, &pwm);
        assert_eq!((hand.positions[1], hand.velocities[1]), (1.61, 0.0));
        assert_eq!(hand.positions[12], 0.263);
        let before = hand.positions;
        hand.step(f64::NAN, &pwm);
        hand.step(-1.0, &pwm);
        assert_eq!(hand.positions, before);
    }
}
