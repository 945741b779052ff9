//! What can be set on the arm, and its checks.

use std::f64::consts::PI;
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Settings of the arm's driver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmConfig {
    /// Mass of hand, adapter and cables, kg. Wrong values look like collisions to the controller.
    pub payload_kg: f64,
    /// Its centre of mass in the flange's frame, mm.
    pub payload_centre_mm: [f64; 3],
    /// How easily the controller sees a collision, 0 (never) to 5.
    pub collision_sensitivity: u8,
    /// Targets a second, 100 to 250.
    pub servo_hz: f64,
    /// A target that needs a faster joint is refused, rad/s.
    pub joint_speed_limit_rad_s: f64,
    /// A target that needs a faster flange is refused, m/s. The controller itself stops at 1.2.
    pub tcp_speed_limit_m_s: f64,
    /// A joint farther than this from its target counts as stuck, rad.
    pub following_limit_rad: f64,
    /// A servo target or a question not answered within this is a fault, s.
    pub reply_timeout_secs: f64,
    /// Reports come every 0.01 s; the newest being older than this is a fault, s.
    pub report_stale_after_secs: f64,
    /// How long each change of mode may take until the arm is ready, s.
    pub start_timeout_secs: f64,
}

impl Default for ArmConfig {
    /// Payload: the paper's hand (fact sheet hardware §0). Limits: the arm's own (§2.6), for the flange below
    /// the speed at which the controller stops. Rates: §2.5.
    fn default() -> Self {
        Self {
            payload_kg: 1.091,
            payload_centre_mm: [-9.72, 18.38, 157.69],
            collision_sensitivity: 3,
            servo_hz: 200.0,
            joint_speed_limit_rad_s: PI,
            tcp_speed_limit_m_s: 1.0,
            following_limit_rad: 0.4,
            reply_timeout_secs: 0.25,
            report_stale_after_secs: 0.1,
            start_timeout_secs: 5.0,
        }
    }
}

/// A setting is outside what the arm allows.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the arm's {name} is {value}; set it to {lowest} or more, and {highest} at most")]
pub struct ArmConfigError {
    /// Which setting.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Smallest allowed value.
    pub lowest: f64,
    /// Largest allowed value.
    pub highest: f64,
}

impl ArmConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// Names the first one that is out of range.
    pub fn check(&self) -> Result<(), ArmConfigError> {
        let [x, y, z] = self.payload_centre_mm;
        let rows = [
            ("payload_kg", self.payload_kg, 0.0, 3.5),
            ("payload_centre_mm (x)", x, -500.0, 500.0),
            ("payload_centre_mm (y)", y, -500.0, 500.0),
            ("payload_centre_mm (z)", z, -500.0, 500.0),
            ("collision_sensitivity", self.collision_sensitivity.into(), 0.0, 5.0),
            ("servo_hz", self.servo_hz, 100.0, 250.0),
            ("joint_speed_limit_rad_s", self.joint_speed_limit_rad_s, 0.01, PI),
            ("tcp_speed_limit_m_s", self.tcp_speed_limit_m_s, 0.01, 1.2),
            ("following_limit_rad", self.following_limit_rad, 0.01, PI),
            ("reply_timeout_secs", self.reply_timeout_secs, 0.01, 10.0),
            ("report_stale_after_secs", self.report_stale_after_secs, 0.02, 10.0),
            ("start_timeout_secs", self.start_timeout_secs, 0.1, 60.0),
        ];
        for (name, value, lowest, highest) in rows {
            if !(lowest..=highest).contains(&value) {
                return Err(ArmConfigError { name, value, lowest, highest });
            }
        }
        Ok(())
    }

    /// Time between two targets.
    pub(crate) fn servo_period(&self) -> Duration {
        Duration::from_secs_f64(1.0 / self.servo_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_allowed_and_odd_values_are_named() {
        assert_eq!(ArmConfig::default().check(), Ok(()));
        type Spoil = fn(&mut ArmConfig);
        let odd: [(&str, Spoil); 4] = [
            ("servo_hz", |config| config.servo_hz = 251.0),
            ("payload_kg", |config| config.payload_kg = f64::NAN),
            ("payload_centre_mm (z)", |config| config.payload_centre_mm[2] = 1577.0),
            ("collision_sensitivity", |config| config.collision_sensitivity = 6),
        ];
        for (name, spoil) in odd {
            let mut config = ArmConfig::default();
            spoil(&mut config);
            assert_eq!(config.check().unwrap_err().name, name);
        }
        assert!(toml::from_str::<ArmConfig>("servo_hz = 100.0").unwrap().check().is_ok());
        assert!(toml::from_str::<ArmConfig>("servo_speed = 100.0").is_err());
    }
}
