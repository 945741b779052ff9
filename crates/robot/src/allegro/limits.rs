//! Units, ranges and torque limits of the hand's joints, one entry per flat joint (index = 4 ×
//! finger + joint).

/// Joints of the hand: four fingers of four.
pub const WIRE_JOINTS: usize = 16;

/// PWM of full duty on a v4 hand (allegro_hand_ros_v4). Torque on the wire is a duty, never a
/// measured N·m.
pub const FULL_SCALE_PWM: i16 = 1200;

/// Angle of one encoder count, rad (allegro_hand_ros_v4).
pub const RAD_PER_COUNT: f64 = 333.3 / 65536.0 * std::f64::consts::PI / 180.0;

/// Largest allowed PWM of each joint, either direction, for the hand on 12 V (allegro_hand_ros_v4).
pub const PWM_LIMITS: [i16; WIRE_JOINTS] =
    [375, 675, 450, 285, 375, 675, 450, 285, 375, 675, 450, 285, 525, 405, 270, 270];

const FINGER: [[f64; 2]; 4] = [[-0.47, 0.47], [-0.196, 1.61], [-0.174, 1.709], [-0.227, 1.618]];
const THUMB: [[f64; 2]; 4] = [[0.263, 1.396], [-0.105, 1.163], [-0.189, 1.644], [-0.162, 1.719]];

/// Lower and upper limit of each joint, rad: the same for the left and the right hand (URDF in
/// allegro_hand_ros2).
pub const JOINT_LIMITS_RAD: [[f64; 2]; WIRE_JOINTS] = {
    let mut limits = [[0.0; 2]; WIRE_JOINTS];
    let mut joint = 0;
    while joint < WIRE_JOINTS {
        limits[joint] = if joint < 12 { FINGER[joint % 4] } else { THUMB[joint % 4] };
        joint += 1;
    }
    limits
};

/// The angle of an encoder reading, rad. No zero offsets: a v4 hand applies its own
/// (allegro_hand_ros_v4).
pub fn rad_from_counts(counts: i16) -> f64 {
    f64::from(counts) * RAD_PER_COUNT
}

/// The encoder reading of an angle, cut towards zero and to what 16 bits hold; 0 for NaN.
pub fn counts_from_rad(rad: f64) -> i16 {
    (rad / RAD_PER_COUNT) as i16
}

/// The torque limit before the wire: the PWM that may be sent for a wanted one. Cut towards zero,
/// within ±`limit`, 0 for anything that is not a finite number.
pub fn clamp_pwm(wanted: f64, limit: i16) -> i16 {
    let limit = limit.max(0);
    if wanted.is_finite() { wanted.clamp(-f64::from(limit), f64::from(limit)) as i16 } else { 0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn counts_by_hand() {
        for (rad, counts) in [(0.1, 1126), (0.5, 5632), (1.0, 11265), (-0.2, -2253)] {
            assert_eq!(counts_from_rad(rad), counts);
        }
        assert!((RAD_PER_COUNT - 8.87632e-5).abs() < 5e-11);
        assert!((rad_from_counts(i16::MIN) + 2.9085).abs() < 1e-3 && counts_from_rad(f64::NAN) == 0);
        let counts: Vec<[i16; 2]> = JOINT_LIMITS_RAD.iter().map(|range| range.map(counts_from_rad)).collect();
        let finger = [[-5294, 5294], [-2208, 18138], [-1960, 19253], [-2557, 18228]];
        assert_eq!((&counts[..4], &counts[4..8], &counts[8..12]), (&finger[..], &finger[..], &finger[..]));
        assert_eq!(counts[12..], [[2962, 15727], [-1182, 13102], [-2129, 18521], [-1825, 19366]]);
    }

    #[test]
    fn limits_as_shares_of_full_scale() {
        let shares = PWM_LIMITS.map(|limit| f64::from(limit) / f64::from(FULL_SCALE_PWM));
        assert_eq!(shares[..4], [0.3125, 0.5625, 0.375, 0.2375]);
        assert_eq!(shares[12..], [0.4375, 0.3375, 0.225, 0.225]);
    }

    proptest! {
        #[test]
        fn counts_come_back(counts in any::<i16>()) {
            // The quarter count keeps the cut towards zero away from the rounding of the product.
            let rad = rad_from_counts(counts) + 0.25 * RAD_PER_COUNT * f64::from(counts.signum());
            prop_assert_eq!(counts_from_rad(rad), counts);
        }

        #[test]
        fn no_pwm_passes_its_limit(bits in any::<u64>(), limit in any::<i16>()) {
            let wanted = f64::from_bits(bits);
            let pwm = clamp_pwm(wanted, limit);
            prop_assert!(pwm.unsigned_abs() <= limit.max(0).unsigned_abs());
            prop_assert!(f64::from(pwm) * wanted >= 0.0 || !wanted.is_finite());
        }
    }
}
