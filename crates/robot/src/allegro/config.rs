//! Settings of the hand, and their ranges.

use etude_checks::{RangeError, check_range, settings};
use serde::{Deserialize, Serialize};

use super::limits::{PWM_LIMITS, WIRE_JOINTS};
use super::messages::{DeviceId, HandSide};

/// Largest age of a position that torque may be computed from, s.
const MAX_STALE_SECS: f64 = 0.1;

settings! {
    /// Settings of the hand.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct HandConfig("hand") {
        /// Which hand on the bus, 0 to 3.
        pub device_id: DeviceId = DeviceId::default();
        /// The hand that must answer: `left` or `right`.
        pub side: HandSide = HandSide::default();
        /// Period of the position frames, and so of the joint loop, ms. The hand is made for 3 ms.
        pub period_ms: u16 = 3, 1.0..=20.0;
        /// Largest PWM of each flat joint; at most [`PWM_LIMITS`].
        pub pwm_limit: [i16; WIRE_JOINTS] = PWM_LIMITS;
        /// Longest start, from the first question to the first positions with the servo on, s.
        pub start_timeout_secs: f64 = 2.0, 0.5..=30.0;
        /// Oldest position of any finger that torque may still be computed from, s: at least three
        /// periods. After more than 0.1 s a held torque could have run a joint at 7 rad/s through
        /// half its range.
        pub stale_after_secs: f64 = 0.015, ..=MAX_STALE_SECS;
        /// Hottest board, °C. Parts of the commercial grade are specified up to 70 °C.
        pub max_board_celsius: u8 = 70, 30.0..=85.0;
        /// Hottest joint, °C. The sensor is not in the winding, which runs some 20 °C hotter and
        /// bears about 85.
        pub max_joint_celsius: u8 = 65, 30.0..=85.0;
    }
}

impl HandConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// Names the first one that is out of its range.
    pub fn check(&self) -> Result<(), RangeError> {
        for (joint, (&value, limit)) in self.pwm_limit.iter().zip(PWM_LIMITS).enumerate() {
            check_range(format!("hand.pwm_limit[{joint}]"), value.into(), 0.0..=limit.into())?;
        }
        self.check_ranges()?;
        let three_periods = f64::from(3 * u32::from(self.period_ms)) / 1000.0;
        check_range("hand.stale_after_secs", self.stale_after_secs, three_periods..=MAX_STALE_SECS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_settings_name_themselves() {
        assert_eq!(HandConfig::default().check(), Ok(()));
        let refused =
            |text: &str| toml::from_str::<HandConfig>(text).unwrap().check().unwrap_err().to_string();
        assert!(refused("period_ms = 0").contains("period_ms"));
        assert!(refused("stale_after_secs = nan").contains("stale_after_secs"));
        assert!(refused("stale_after_secs = 0.008").contains("0.009 to 0.1"), "three periods");
        assert!(refused("max_joint_celsius = 90").contains("85"));
        for (joint, limit) in PWM_LIMITS.iter().enumerate() {
            for value in [limit + 1, -1] {
                let mut config = HandConfig::default();
                config.pwm_limit[joint] = value;
                let refused = config.check().unwrap_err();
                assert_eq!((refused.name, refused.value), (format!("hand.pwm_limit[{joint}]"), value.into()));
                assert_eq!(refused.allowed.high, std::ops::Bound::Included(f64::from(*limit)));
            }
        }
        assert_eq!(toml::from_str::<HandConfig>("side = \"right\"").unwrap().side, HandSide::Right);
        for text in ["side = \"Right\"", "device_id = 4", "periods = 3"] {
            toml::from_str::<HandConfig>(text).unwrap_err();
        }
    }
}
