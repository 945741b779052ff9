//! Joint angles become torques, at the hand's own clock.
//!
//! A PD law, pwm = kp·(wanted − measured) − kd·velocity, as in all public drivers of this hand.
//! Those divide by a fixed or wrapping time step. Here the velocity is the difference over the true
//! time between frames, so that a lost period does not distort it, followed by a first-order
//! low-pass with the same time step.

use std::time::Duration;

use etude_checks::{RangeError, settings};
use serde::{Deserialize, Serialize};

use super::gravity::holding_torques;
use super::limits::WIRE_JOINTS;

/// Differences over less than this are noise: the older reading is kept until more time has passed.
const MIN_SECS: f64 = 0.0005;

settings! {
    /// Gains, one a joint of a finger, the same for all fingers and the thumb.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct JointLoopConfig("joint_loop") {
        /// Stiffness, PWM / rad. The default is 3.0 of full scale 1200 for each rad.
        pub kp: [f64; 4] = [3600.0; 4], 0.0..=20_000.0;
        /// Damping, PWM / (rad/s). The default is 0.1 of full scale 1200 for each rad/s.
        pub kd: [f64; 4] = [120.0; 4], 0.0..=1_000.0;
        /// Cut-off of the velocity's low-pass, Hz.
        pub velocity_filter_hz: f64 = 30.0, 1.0..=1000.0;
        /// PWM for each N·m that holds the fingers against gravity; 0 for none. The default is the
        /// full scale for 1 N·m.
        pub gravity_pwm_per_nm: f64 = 1200.0, 0.0..=3600.0;
    }
}

/// The joint loop of one hand.
#[derive(Clone, Debug)]
pub struct JointLoop {
    config: JointLoopConfig,
    last: Option<(Duration, [f64; WIRE_JOINTS])>,
    velocities: [f64; WIRE_JOINTS],
}

impl JointLoop {
    /// A loop without any reading yet.
    ///
    /// # Errors
    /// If a gain is out of its range.
    pub fn new(config: &JointLoopConfig) -> Result<Self, RangeError> {
        config.check_ranges()?;
        Ok(Self { config: config.clone(), last: None, velocities: [0.0; WIRE_JOINTS] })
    }

    /// Discards all readings, for a new start of the hand.
    pub fn reset(&mut self) {
        self.last = None;
        self.velocities = [0.0; WIRE_JOINTS];
    }

    /// The wanted PWM of each flat joint, unclamped, for positions measured at `at` and references,
    /// both in rad, and the cosine of the angle between the palm's normal and straight down. A
    /// number that is not finite gives a PWM that is not, which
    /// [`Hand::send_pwm`](super::Hand::send_pwm) sends as 0; it does not stay in the filter.
    pub fn pwm(
        &mut self,
        at: Duration,
        positions: &[f64; WIRE_JOINTS],
        reference: &[f64; WIRE_JOINTS],
        palm_down: f64,
    ) -> [f64; WIRE_JOINTS] {
        self.measure(at, positions);
        let holding = holding_torques(positions);
        let gravity = palm_down * self.config.gravity_pwm_per_nm;
        std::array::from_fn(|joint| {
            let (kp, kd) = (self.config.kp[joint % 4], self.config.kd[joint % 4]);
            kp * (reference[joint] - positions[joint]) - kd * self.velocities[joint]
                + gravity * holding[joint]
        })
    }

    fn measure(&mut self, at: Duration, positions: &[f64; WIRE_JOINTS]) {
        let Some((last_at, last)) = &mut self.last else {
            self.last = Some((at, *positions));
            return;
        };
        let secs = at.saturating_sub(*last_at).as_secs_f64();
        if secs < MIN_SECS {
            return;
        }
        let share = 1.0 - (-std::f64::consts::TAU * self.config.velocity_filter_hz * secs).exp();
        for ((velocity, last), &position) in self.velocities.iter_mut().zip(last.iter_mut()).zip(positions) {
            let measured = (position - *last) / secs;
            if measured.is_finite() {
                *velocity += share * (measured - *velocity);
            }
            *last = position;
        }
        *last_at = at;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ms(millis: f64) -> Duration {
        Duration::from_secs_f64(millis / 1000.0)
    }

    #[test]
    fn the_law_by_hand() {
        let mut joints = JointLoop::new(&JointLoopConfig::default()).unwrap();
        let mut positions = [0.2; WIRE_JOINTS];
        let pwm = joints.pwm(ms(10.0), &positions, &[0.3; WIRE_JOINTS], 0.0);
        assert!((pwm[0] - 360.0).abs() < 1e-9, "no velocity from one reading: {}", pwm[0]);
        positions[5] += 0.003;
        let pwm = joints.pwm(ms(13.0), &positions, &[0.3; WIRE_JOINTS], 0.0);
        // 1 rad/s through the low-pass: 1 − exp(−2π · 30 Hz · 3 ms) = 0.4319.
        assert!((joints.velocities[5] - 0.431_92).abs() < 1e-4, "{}", joints.velocities[5]);
        assert!((pwm[5] - (3600.0 * 0.097 - 120.0 * 0.431_92)).abs() < 0.05, "{}", pwm[5]);
        assert!((pwm[4] - 360.0).abs() < 1e-9);
    }

    #[test]
    fn a_broken_number_is_gone_with_the_next() {
        let mut joints = JointLoop::new(&JointLoopConfig::default()).unwrap();
        let mut positions = [0.0; WIRE_JOINTS];
        let _ = joints.pwm(ms(0.0), &positions, &[0.0; WIRE_JOINTS], 0.0);
        positions[3] = f64::NAN;
        assert!(joints.pwm(ms(3.0), &positions, &[0.0; WIRE_JOINTS], 0.0)[3].is_nan());
        for n in 2..5 {
            positions[3] = 0.0;
            assert_eq!(joints.pwm(ms(3.0 * f64::from(n)), &positions, &[0.0; WIRE_JOINTS], 0.0)[3], 0.0);
        }
    }

    #[test]
    fn refused_gains() {
        for text in ["kp = [0.0, 0.0, 0.0, nan]", "kd = [-1.0, 0.0, 0.0, 0.0]", "velocity_filter_hz = 0.0"] {
            JointLoop::new(&toml::from_str(text).unwrap()).unwrap_err();
        }
    }

    proptest! {
        /// On a ramp the velocity comes out right whichever periods are lost or delivered together.
        #[test]
        fn lost_periods_do_not_change_the_velocity(
            speed in -7.0..7.0,
            gaps in prop::collection::vec(prop_oneof![Just(3.0), Just(6.0), 0.0..9.0], 100),
        ) {
            let mut joints = JointLoop::new(&JointLoopConfig::default()).unwrap();
            let mut at = 0.0;
            for gap in gaps {
                at += gap;
                let _ = joints.pwm(ms(at), &[speed * ms(at).as_secs_f64(); WIRE_JOINTS], &[0.0; WIRE_JOINTS], 0.0);
                // Never beyond the true value: a wrong time step would overshoot.
                prop_assert!(joints.velocities[0].abs() <= f64::abs(speed) * (1.0 + 1e-6));
            }
            prop_assert!((joints.velocities[0] - speed).abs() < 1e-3 * speed.abs() + 1e-9);
        }
    }
}
