//! What can be set on the arm, and its checks.

use std::f64::consts::PI;
use std::time::Duration;

use etude_checks::{RangeError, settings};
use serde::{Deserialize, Serialize};

use crate::xarm::safety_box::SafetyBox;

settings! {
    /// Settings of the arm's driver. Limits, rates and ranges: the xArm user manual.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct ArmConfig("arm") {
        /// Mass of hand, adapter and cables, kg. Wrong values look like collisions to the
        /// controller. The default is the paper's hand (lasr-lab/learning-to-play-piano).
        pub payload_kg: f64 = 1.091, 0.0..=3.5;
        /// Its centre of mass in the flange's frame, mm.
        pub payload_centre_mm: [f64; 3] = [-9.72, 18.38, 157.69], -500.0..=500.0;
        /// How easily the controller sees a collision, 0 (never) to 5.
        pub collision_sensitivity: u8 = 3, 0.0..=5.0;
        /// Box that the flange must stay in, mm in the frame of the arm's base: lowest and highest
        /// x, y, z. Without one, the controller keeps its own setting.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub box_mm: Option<SafetyBox> = None;
        // The controller's default jerks and largest accelerations. They replace what another
        // program has set. Servo mode is documented to use the largest acceleration, which may be
        // this one. With smaller values than the least a move home would take minutes.
        /// Jerk of straight moves that the arm plans itself, m/s³.
        pub tcp_jerk_m_s3: f64 = 7.0, 0.1..=100.0;
        /// Largest acceleration of them, m/s².
        pub tcp_acceleration_m_s2: f64 = 50.0, 0.1..=50.0;
        /// Jerk of joint moves that the arm plans itself, rad/s³.
        pub joint_jerk_rad_s3: f64 = 200.0, 1.0..=499.9;
        /// Largest acceleration of them, rad/s².
        pub joint_acceleration_rad_s2: f64 = 19.98, 0.1..=19.98;
        /// Targets a second, 100 to 250; fewer are sent over a link that does not carry so many.
        pub servo_hz: f64 = 200.0, 100.0..=250.0;
        /// A target that needs a faster joint is refused, rad/s.
        pub joint_speed_limit_rad_s: f64 = PI, 0.01..=PI;
        /// A target that needs a faster flange is refused, m/s. The controller itself stops at 1.2.
        pub tcp_speed_limit_m_s: f64 = 1.0, 0.01..=1.2;
        /// A joint farther than this from its target counts as stuck, rad.
        pub following_limit_rad: f64 = 0.4, 0.01..=PI;
        /// A servo target or a question not answered within this is a fault, s.
        pub reply_timeout_secs: f64 = 0.25, 0.01..=10.0;
        /// Reports come every 0.01 s; the newest being older than this is a fault, s.
        pub report_stale_after_secs: f64 = 0.1, 0.02..=10.0;
        /// How long each change of mode may take until the arm is ready, s.
        pub start_timeout_secs: f64 = 5.0, 0.1..=60.0;
    }
}

impl ArmConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// Names the first one that is out of range.
    pub fn check(&self) -> Result<(), RangeError> {
        self.check_ranges()?;
        self.box_mm.map_or(Ok(()), SafetyBox::check)
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
        let odd: [(&str, Spoil); 11] = [
            ("servo_hz", |config| config.servo_hz = 251.0),
            ("payload_kg", |config| config.payload_kg = f64::NAN),
            ("payload_centre_mm[2]", |config| config.payload_centre_mm[2] = 1577.0),
            ("collision_sensitivity", |config| config.collision_sensitivity = 6),
            // 1145 °/s², 28647 °/s³, 50000 mm/s² and 100000 mm/s³ are the most that the controller
            // takes.
            ("tcp_jerk_m_s3", |config| config.tcp_jerk_m_s3 = 100.1),
            ("tcp_acceleration_m_s2", |config| config.tcp_acceleration_m_s2 = 50.1),
            ("joint_jerk_rad_s3", |config| config.joint_jerk_rad_s3 = 28648_f64.to_radians()),
            ("joint_acceleration_rad_s2", |config| config.joint_acceleration_rad_s2 = 1146_f64.to_radians()),
            ("box_mm (highest x)", |config| config.box_mm = Some(SafetyBox([[1, 50], [1, 51], [1, 51]]))),
            ("box_mm (lowest z)", |config| config.box_mm = Some(SafetyBox([[1, 51], [1, 51], [-401, 51]]))),
            ("box_mm (lowest y)", |config| {
                config.box_mm = Some(SafetyBox([[1, 51], [i32::MAX, i32::MIN], [1, 51]]));
            }),
        ];
        for (name, spoil) in odd {
            let mut config = ArmConfig::default();
            spoil(&mut config);
            assert_eq!(config.check().unwrap_err().name, format!("arm.{name}"));
        }
        assert!(toml::from_str::<ArmConfig>("servo_hz = 100.0").unwrap().check().is_ok());
        assert!(toml::from_str::<ArmConfig>("servo_speed = 100.0").is_err());
        let has_box = "box_mm = [[300, 700], [-450, 450], [100, 700]]";
        let has_box: ArmConfig = toml::from_str(has_box).unwrap();
        assert!(
            has_box.check().is_ok()
                && has_box.box_mm == Some(SafetyBox([[300, 700], [-450, 450], [100, 700]]))
        );
        assert_eq!(toml::from_str::<ArmConfig>(&toml::to_string(&has_box).unwrap()).unwrap(), has_box);
    }
}
