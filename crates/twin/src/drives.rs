//! The hand between its wires and its links: what a duty does to a joint, and what an encoder makes
//! of an angle.
//!
//! Here backlash is between encoder and link: a link that turns back has turned through the
//! backlash before the encoder follows. The backlash that a motor's torque has to cross is in
//! `backlash`.

use etude_robot::allegro::{self, FULL_SCALE_PWM};
use etude_robot::joints::HAND_DRIVEN_JOINTS;
use etude_stage::DRIVEN_JOINTS;

use crate::hidden_params::{FINGER, HandParams, STEP};

/// The drives of the fingers.
pub(crate) struct Drives {
    full_torque_nm: [f64; FINGER],
    dead_pwm: f64,
    /// Torque that the motor's own voltage takes away, as a share of the full torque for each
    /// rad/s.
    lost_per_speed: f64,
}

impl Drives {
    pub(crate) fn new(hand: &HandParams) -> Self {
        Self {
            full_torque_nm: hand.full_torque_nm,
            dead_pwm: hand.dead_pwm.into(),
            lost_per_speed: hand.no_load_rad_per_sec.map_or(0.0, f64::recip),
        }
    }

    /// Torque of the motor of flat joint `joint` (any but the thumb's) under this duty when it
    /// turns at `speed`, rad/s, N·m.
    pub(crate) fn torque(&self, joint: usize, pwm: &[i16; allegro::WIRE_JOINTS], speed: f64) -> f64 {
        let pwm = f64::from(pwm.get(joint).copied().unwrap_or_default());
        let beyond = (pwm.abs() - self.dead_pwm).max(0.0).copysign(pwm);
        let share = beyond / f64::from(FULL_SCALE_PWM) - self.lost_per_speed * speed;
        share * self.full_torque_nm[joint % FINGER]
    }
}

/// The encoders of the fingers, and the filter behind them.
pub(crate) struct Encoders {
    half_backlash: f64,
    /// Share of the way to the unfiltered position in one step.
    pace: f64,
    /// Where the drives are, and what the filter says; none before the first reading.
    state: Option<([f64; HAND_DRIVEN_JOINTS], [f64; HAND_DRIVEN_JOINTS])>,
}

impl Encoders {
    pub(crate) fn new(hand: &HandParams) -> Self {
        let steps = hand.filter_secs / STEP.as_secs_f64();
        Self {
            half_backlash: hand.encoder_backlash_rad / 2.0,
            pace: if steps > 0.0 { 1.0 - (-1.0 / steps).exp() } else { 1.0 },
            state: None,
        }
    }

    /// What they read one [`STEP`] later, now that the links are at `joints` (rad). The rail has
    /// none.
    pub(crate) fn read(&mut self, joints: &[f64; DRIVEN_JOINTS]) -> [f64; DRIVEN_JOINTS] {
        let links: [f64; HAND_DRIVEN_JOINTS] = std::array::from_fn(|joint| joints[joint]);
        let (drives, filtered) = self.state.get_or_insert((links, links));
        for ((drive, filtered), link) in drives.iter_mut().zip(filtered.iter_mut()).zip(links) {
            *drive = drive.max(link - self.half_backlash).min(link + self.half_backlash);
            *filtered += self.pace * (*drive - *filtered);
        }
        std::array::from_fn(|joint| filtered.get(joint).copied().unwrap_or(joints[joint]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_stage::RAIL;
    use proptest::prelude::*;

    #[test]
    fn each_joint_of_a_finger_has_its_own_torque_beyond_the_dead_band() {
        let full_torque_nm = [1.0, 2.0, 3.0, 4.0];
        let drives = Drives::new(&HandParams { full_torque_nm, dead_pwm: 20, ..HandParams::default() });
        let torque = |joint: usize, pwm: i16| drives.torque(joint, &[pwm; allegro::WIRE_JOINTS], 0.0);
        for pwm in [-20, -7, 0, 1, 20] {
            assert_eq!(torque(5, pwm), 0.0);
        }
        let close =
            |torque: f64, expected: f64| assert!((torque - expected).abs() < 1e-12, "{torque} {expected}");
        close(torque(5, 140), 120.0 / 1200.0 * 2.0);
        close(torque(11, -260), -240.0 / 1200.0 * 4.0);
        close(torque(0, 1220), 1.0);
        close(torque(2, i16::MIN), -(32768.0 - 20.0) / 1200.0 * 3.0);
    }

    #[test]
    fn a_motor_loses_torque_with_speed_and_has_none_at_its_no_load_speed() {
        let drives = Drives::new(&HandParams { no_load_rad_per_sec: Some(8.0), ..HandParams::default() });
        let torque = |pwm: i16, speed: f64| drives.torque(5, &[pwm; allegro::WIRE_JOINTS], speed);
        assert!((torque(1200, 0.0) - 1.0).abs() < 1e-12 && torque(1200, 8.0).abs() < 1e-12);
        assert!((torque(600, 2.0) - 0.25).abs() < 1e-12 && (torque(0, -4.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn backlash_is_a_dead_band_on_the_way_back() {
        let mut encoders = Encoders::new(&HandParams { encoder_backlash_rad: 0.02, ..HandParams::default() });
        let mut read = |angle: f64| encoders.read(&[angle; DRIVEN_JOINTS])[4];
        assert_eq!(read(0.0), 0.0);
        assert!((read(0.5) - 0.49).abs() < 1e-12);
        for back in [0.499, 0.49, 0.481] {
            assert!((read(back) - 0.49).abs() < 1e-12, "{back}");
        }
        assert!((read(0.4) - 0.41).abs() < 1e-12);
        assert_eq!(encoders.read(&[0.25; DRIVEN_JOINTS])[RAIL], 0.25);
    }

    #[test]
    fn the_filter_is_of_first_order() {
        let mut encoders = Encoders::new(&HandParams { filter_secs: 0.004, ..HandParams::default() });
        encoders.read(&[0.0; DRIVEN_JOINTS]);
        for step in 1..=8 {
            let read = encoders.read(&[1.0; DRIVEN_JOINTS])[0];
            let expected = 1.0 - (-f64::from(step) / 4.0).exp();
            assert!((read - expected).abs() < 1e-12, "{step}: {read}");
        }
    }

    proptest! {
        #[test]
        fn a_reading_is_never_off_by_more_than_half_the_backlash(
            backlash in 0.0..0.1f64,
            angles in prop::collection::vec(-2.0..2.0f64, 1..50),
        ) {
            let mut encoders = Encoders::new(&HandParams { encoder_backlash_rad: backlash, ..HandParams::default() });
            for angle in angles {
                let read = encoders.read(&[angle; DRIVEN_JOINTS])[7];
                prop_assert!((read - angle).abs() <= backlash / 2.0 + 1e-12);
            }
        }
    }
}
