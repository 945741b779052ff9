//! Where an arm really holds its hand: it sags, and its kinematics are not quite those that its
//! controller computes with.
//!
//! Both are what remains after the keyboard was shown to the arm at its ends and in its middle.

use std::f64::consts::{PI, TAU};

use etude_stage::geometry::HALF_WIDTH;

use crate::hidden_params::{ArmParams, Purpose, signed_share};

/// How far the hand is off the place that the arm's joints say.
pub(crate) struct Mount {
    sag_m: f64,
    error_m: f64,
    /// Radians of the error for each metre along the keyboard.
    waves: f64,
    phases: [f64; 3],
}

impl Mount {
    pub(crate) fn new(arm: &ArmParams, seed: u64) -> Self {
        Self {
            sag_m: arm.sag_m,
            error_m: arm.error_m,
            waves: TAU / arm.error_period_m,
            phases: std::array::from_fn(|axis| PI * signed_share(seed, Purpose::KinematicError, axis)),
        }
    }

    /// Offset of the hand at this place on the rail (m) toward the player, toward the high notes
    /// and up, m. None if there never is one.
    pub(crate) fn offset(&self, rail: f64) -> Option<[f64; 3]> {
        if self.sag_m == 0.0 && self.error_m == 0.0 {
            return None;
        }
        let mut offset = self.phases.map(|phase| self.error_m * (self.waves * rail + phase).sin());
        offset[2] -= self.sag_m * (rail / HALF_WIDTH).powi(2);
        Some(offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arm_sags_toward_the_ends_and_is_off_by_its_error_at_most() {
        let mount = |text: &str| Mount::new(&toml::from_str(text).unwrap(), 3);
        assert_eq!(mount("").offset(0.2), None);
        let sagging = mount("sag_m = 0.001");
        assert_eq!(sagging.offset(0.0), Some([0.0; 3]));
        assert_eq!(sagging.offset(HALF_WIDTH), Some([0.0, 0.0, -0.001]));
        assert_eq!(sagging.offset(-HALF_WIDTH / 2.0), Some([0.0, 0.0, -0.00025]));
        let off = mount("error_m = 0.0003\nerror_period_m = 0.1");
        let places = (0..100).map(|place| off.offset(f64::from(place) * 1e-3).unwrap());
        let most = places.fold([0.0_f64; 3], |most, offset| {
            std::array::from_fn(|axis| most[axis].max(offset[axis].abs()))
        });
        assert!(most.iter().all(|most| (0.00029..=0.0003).contains(most)), "{most:?}");
        let [one, next] = [0.013, 0.113].map(|place| off.offset(place).unwrap());
        assert!((0..3).all(|axis| (one[axis] - next[axis]).abs() < 1e-12), "it repeats");
        assert!(one[0] != one[1] && one[1] != one[2], "each direction has its own");
    }
}
