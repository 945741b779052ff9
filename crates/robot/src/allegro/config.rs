//! What an operator may set about the hand, and what is refused.

use serde::{Deserialize, Serialize};

use super::limits::{JOINTS, PWM_LIMITS};
use super::messages::{DeviceId, HandSide};

/// Settings of the hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandConfig {
    /// Which hand on the bus, 0 to 3.
    pub device_id: DeviceId,
    /// The hand that must answer: `left` or `right`.
    pub side: HandSide,
    /// Period of the position frames, and so of the joint loop, ms.
    pub period_ms: u16,
    /// Largest PWM of each flat joint; at most the table of hardware §1.4.
    pub pwm_limit: [i16; JOINTS],
    /// Longest start, from the first question to the first positions with the servo on, s.
    pub start_timeout_secs: f64,
    /// Oldest position of any finger that torque may still be computed from, s.
    pub stale_after_secs: f64,
    /// Hottest board, °C. Parts of the commercial grade are specified up to 70 °C.
    pub max_board_celsius: u8,
    /// Hottest joint, °C. The sensor is not in the winding, which runs some 20 °C hotter and bears about 85.
    pub max_joint_celsius: u8,
}

impl Default for HandConfig {
    fn default() -> Self {
        Self {
            device_id: DeviceId::default(),
            side: HandSide::default(),
            period_ms: 3,
            pwm_limit: PWM_LIMITS,
            start_timeout_secs: 2.0,
            stale_after_secs: 0.015,
            max_board_celsius: 70,
            max_joint_celsius: 65,
        }
    }
}

/// A setting that the hand must not run with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HandConfigError {
    /// Outside its range.
    #[error("hand.{name} is {value}: set it to {wanted}")]
    Range {
        /// The setting.
        name: &'static str,
        /// What it is.
        value: f64,
        /// What it may be.
        wanted: &'static str,
    },
    /// Above the table.
    #[error("hand.pwm_limit[{joint}] is {value}: set it to 0 to {limit}, what this joint bears")]
    Pwm {
        /// The flat joint.
        joint: usize,
        /// What it is.
        value: i16,
        /// What it may be.
        limit: i16,
    },
}

impl HandConfig {
    /// Refuses what the hand must not run with.
    ///
    /// # Errors
    /// Names the first setting out of its range.
    pub fn check(&self) -> Result<(), HandConfigError> {
        for (joint, (&value, limit)) in self.pwm_limit.iter().zip(PWM_LIMITS).enumerate() {
            if !(0..=limit).contains(&value) {
                return Err(HandConfigError::Pwm { joint, value, limit });
            }
        }
        let range = |name, value: f64, good: bool, wanted| {
            // A NaN is in no range.
            if good { Ok(()) } else { Err(HandConfigError::Range { name, value, wanted }) }
        };
        let period = f64::from(self.period_ms);
        range(
            "period_ms",
            period,
            (1..=20).contains(&self.period_ms),
            "1 to 20 ms (the hand is made for 3)",
        )?;
        let (start, stale) = (self.start_timeout_secs, self.stale_after_secs);
        range("start_timeout_secs", start, (0.5..=30.0).contains(&start), "0.5 to 30 s")?;
        let shortest = 3.0 * period / 1000.0;
        // Longer than this, and a held torque could run a joint at 7 rad/s through half its range.
        let wanted = "at least three periods and at most 0.1 s";
        range("stale_after_secs", stale, (shortest - 1e-9..=0.1).contains(&stale), wanted)?;
        let wanted = "30 to 85 °C";
        for (name, celsius) in
            [("max_board_celsius", self.max_board_celsius), ("max_joint_celsius", self.max_joint_celsius)]
        {
            range(name, f64::from(celsius), (30..=85).contains(&celsius), wanted)?;
        }
        Ok(())
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
        assert!(refused("stale_after_secs = 0.008").contains("three periods"));
        assert!(refused("max_joint_celsius = 90").contains("85"));
        for (joint, limit) in PWM_LIMITS.iter().enumerate() {
            for value in [limit + 1, -1] {
                let mut config = HandConfig::default();
                config.pwm_limit[joint] = value;
                assert_eq!(config.check(), Err(HandConfigError::Pwm { joint, value, limit: *limit }));
            }
        }
        assert_eq!(toml::from_str::<HandConfig>("side = \"right\"").unwrap().side, HandSide::Right);
        for text in ["side = \"Right\"", "device_id = 4", "periods = 3"] {
            toml::from_str::<HandConfig>(text).unwrap_err();
        }
    }
}
