//! How hot the motors of the hand are.

use std::time::Duration;

use crate::allegro::{PWM_LIMITS, WIRE_JOINTS};

/// Time in which a motor heats up and cools down, s.
const HEATING_SECS: f64 = 10.0;
/// The heat that is too much: sixteen seconds at the limit from cold.
const MAX_HEAT: f64 = 0.8;
/// A longer time between two periods is one without torque.
const MAX_PERIOD: Duration = Duration::from_millis(50);

/// The heat of the motors: for each joint the mean of its squared torque in the last seconds, as
/// the losses of a motor are. The torque is a share of the joint's limit, so that the heat is
/// between 0 and 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorHeat {
    joints: [f64; WIRE_JOINTS],
    /// When the torques were read last.
    at: Option<Duration>,
}

impl MotorHeat {
    /// The heat of each joint at `at`; `None` if a number is not between 0 and 1.
    pub fn new(at: Duration, joints: [f64; WIRE_JOINTS]) -> Option<Self> {
        let sound = joints.iter().all(|heat| (0.0..=1.0).contains(heat));
        sound.then_some(Self { joints, at: Some(at) })
    }

    /// The heat of each joint after it has cooled until `now`.
    pub fn joints(&self, now: Duration) -> [f64; WIRE_JOINTS] {
        let left = left_after(now.saturating_sub(self.at.unwrap_or(now)));
        self.joints.map(|heat| heat * left)
    }

    /// Takes the torques of a period that ends at `at`.
    pub(super) fn take(&mut self, at: Duration, pwm: &[i16; WIRE_JOINTS]) {
        let period = at.saturating_sub(self.at.unwrap_or(at));
        let (left, driven) = (left_after(period), period <= MAX_PERIOD);
        self.at = Some(at);
        for (heat, (pwm, limit)) in self.joints.iter_mut().zip(pwm.iter().zip(PWM_LIMITS)) {
            let share = if driven { f64::from(*pwm) / f64::from(limit) } else { 0.0 };
            *heat = share * share + (*heat - share * share) * left;
        }
    }

    /// The first joint that is too hot, and its heat.
    pub(super) fn too_hot(&self) -> Option<(usize, f64)> {
        self.joints.iter().copied().enumerate().find(|(_, heat)| *heat > MAX_HEAT)
    }
}

/// The share of a heat that is left after a time.
fn left_after(time: Duration) -> f64 {
    (-time.as_secs_f64() / HEATING_SECS).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn motors_heat_up_and_cool_down() {
        let mut pwm = [0; WIRE_JOINTS];
        (pwm[3], pwm[9]) = (-PWM_LIMITS[3], PWM_LIMITS[9] / 2);
        let mut motor_heat = MotorHeat::default();
        (0..=2500).for_each(|period| motor_heat.take(4 * MS * period, &pwm));
        let at = 10_000 * MS;
        let [cold, full, half] = [0, 3, 9].map(|joint| motor_heat.joints(at)[joint]);
        let tenth = 1.0 - (-1.0f64).exp();
        assert!(cold == 0.0 && (full - tenth).abs() < 1e-9, "{full}");
        assert!((half - tenth / 4.0).abs() < 0.01, "{half}");
        assert!((motor_heat.joints(2 * at)[3] - tenth * (-1.0f64).exp()).abs() < 1e-9);

        // The first torques after a pause do not count for it, as those after a period do.
        let after = |pause: Duration| {
            let mut motor_heat = motor_heat;
            motor_heat.take(at + pause, &pwm);
            motor_heat.joints(at + pause)[3] - full
        };
        assert!(after(50 * MS) > 0.0 && after(51 * MS) < 0.0);
        assert!((after(10_000 * MS) + full * tenth).abs() < 1e-9);
    }

    #[test]
    fn a_warmth_is_between_nothing_and_everything() {
        let one = |heat| {
            let mut joints = [0.5; WIRE_JOINTS];
            joints[15] = heat;
            MotorHeat::new(MS, joints)
        };
        assert_eq!(one(1.0).unwrap().joints(MS)[15], 1.0);
        assert!([-0.001, 1.001, f64::NAN, f64::INFINITY].iter().all(|heat| one(*heat).is_none()));
    }
}
