//! A rig: which devices there are, on which wires, and what they may do. One TOML file a rig.

use std::path::{Path, PathBuf};

use etude_checks::{RangeError, check_range, positive_to, settings};
use serde::{Deserialize, Serialize};

use crate::allegro::{HandConfig, JOINT_LIMITS_RAD, JointLoopConfig, WIRE_JOINTS};
use crate::joints::HAND_DRIVEN_JOINTS;
use crate::keyboard::KeyboardConfig;
use crate::limiter::AxisLimits;
use crate::xarm::ArmConfig;

/// Set-points per second: the physics steps of the simulator that a policy is trained in.
pub const SETPOINT_HZ: f64 = 200.0;

/// A rig as its file describes it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigConfig {
    /// Its name, which calibrations and recordings contain.
    pub name: String,
    /// Where the devices are.
    pub wires: WiresConfig,
    /// File of the keyboard's place, relative to the rig's file.
    pub calibration: PathBuf,
    /// Limits of joints and rail, and of the calibration's age.
    pub limits: LimitsConfig,
    /// The hand.
    pub hand: HandConfig,
    /// The joint loop on the hand's positions.
    pub joint_loop: JointLoopConfig,
    /// The arm.
    pub arm: ArmConfig,
    /// The keyboard.
    pub keyboard: KeyboardConfig,
}

settings! {
    /// Where the devices are. The defaults are as the devices come: the first CAN interface, the
    /// arm's address after a reset, the keyboard by its name.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct WiresConfig {
        /// The hand's bus: an interface such as `can0`, `slcan:/dev/ttyUSB0`, or `bus:SOCKET` of
        /// another process.
        pub can: String = "can0".into();
        /// The arm's address.
        pub arm: String = "192.168.1.111".into();
        /// The keyboard: `alsa:NAME` (part of the port's name), `raw:DEVICE`, or `midi:SOCKET` of
        /// another process.
        pub midi: String = "alsa:Keystation".into();
    }
}

/// Highest limits of a finger joint's set-point: rad/s, rad/s², rad/s³. So far a policy's targets
/// may jump; the torque clamp bounds the joint.
pub const MAX_FINGER_LIMITS: [f64; 3] = [55.0, 5300.0, 1_060_000.0];
/// The same of the rail: m/s, m/s², m/s³.
pub const MAX_RAIL_LIMITS: [f64; 3] = [1.0, 14.0, 5000.0];

settings! {
    /// Limits of joints and rail, and of the calibration's age. Fingers: rad and s. Rail: m and s.
    ///
    /// No limit can be set above what the devices allow. Servo mode, in which the arm makes the
    /// rail, has no documented jerk limit; the arm's planned moves use 100 m/s³ at the flange at
    /// most (xArm user manual).
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct LimitsConfig("limits") {
        /// Largest speed of a finger joint's set-point, rad/s. The default is the highest speed
        /// that allegro_hand_ros_v4 names. More makes no joint faster: the torque clamp and the
        /// motor bound it.
        pub finger_velocity: f64 = 13.0, positive_to(MAX_FINGER_LIMITS[0]);
        /// Largest acceleration, rad/s². By default from rest to full speed in 6.5 ms, two periods
        /// of the hand. The torque clamp bounds the fingers before this does.
        pub finger_acceleration: f64 = 2000.0, positive_to(MAX_FINGER_LIMITS[1]);
        /// Largest jerk, rad/s³. By default the full acceleration within one set-point.
        pub finger_jerk: f64 = 400_000.0, positive_to(MAX_FINGER_LIMITS[2]);
        /// Part of the rail that may be used, m from the middle of the keyboard. At most the
        /// keyboard's own end and some room.
        pub rail_range_m: [f64; 2] = [-0.337, 0.337], -0.40..=0.40;
        /// Largest speed on the rail, m/s. At most the flange's own limit; at 1.2 m/s the arm stops
        /// itself with error 60 (xArm user manual).
        pub rail_velocity: f64 = 0.8, positive_to(MAX_RAIL_LIMITS[0]);
        /// Largest acceleration, m/s². The default is the arm's 1145 °/s² over the 2.57 rad that
        /// joint 4 turns a metre: 7.8 m/s² where it turns most. In servo mode the controller does
        /// not look.
        pub rail_acceleration: f64 = 7.5, positive_to(MAX_RAIL_LIMITS[1]);
        /// Largest jerk, m/s³. By default the full acceleration in one set-point, as the arm itself
        /// would take it in servo mode; at most nearly all of the largest one, from one direction
        /// to the other, within one set-point.
        pub rail_jerk: f64 = 1500.0, positive_to(MAX_RAIL_LIMITS[2]);
        /// Where the thumb stays, rad. The default is the unused thumb of
        /// lasr-lab/learning-to-play-piano.
        pub thumb_rad: [f64; 4] = [0.363, 0.0, 0.0, 0.0];
        /// How far a finger joint may be from the first command, rad.
        pub start_finger_rad: f64 = 0.2, positive_to(0.5);
        /// How far the hand may be from the first command, m.
        pub start_rail_m: f64 = 0.01, positive_to(0.05);
        /// How long the last command stands without a new one before the robot is stopped, s. The
        /// default is three control steps.
        pub stale_command_secs: f64 = 0.15, positive_to(2.0);
        /// How far a joint of the hand may be from its reference while it holds or moves, rad; at
        /// most a quarter of its range. The default is three times where the joint loop already
        /// pushes as hard as it may (675 of 3600 PWM a rad). Policies press by asking for far below
        /// a key: 1.2 rad for as long as a note is held, and no note of the songs is held for five
        /// seconds.
        pub following_rad: f64 = 0.6, positive_to(1.5);
        /// How long it may be farther, s.
        pub following_secs: f64 = 5.0, positive_to(10.0);
        /// Oldest calibration that is still trusted, days.
        pub calibration_days: u64 = 7, 0.0..=365.0;
    }
}

/// The rig's file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// It cannot be read.
    #[error("cannot read the rig {path}: {message}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// A limit is not sound.
    #[error("limits of {joint}: {message}")]
    Limits {
        /// Which joint.
        joint: String,
        /// What is wrong.
        message: String,
    },
    /// Something else is not sound.
    #[error("{0}")]
    Value(String),
    /// A setting is out of its range.
    #[error(transparent)]
    Setting(#[from] RangeError),
}

impl RigConfig {
    /// Reads and checks a rig's file. The path of the calibration becomes one from the working
    /// folder.
    ///
    /// # Errors
    /// If the file cannot be read, names something unknown, or asks for what the devices cannot
    /// bear.
    pub fn load(path: &Path) -> Result<Self, RigError> {
        let read = |message: String| RigError::Read { path: path.to_path_buf(), message };
        let text = std::fs::read_to_string(path).map_err(|error| read(error.to_string()))?;
        let mut config: Self = toml::from_str(&text).map_err(|error| read(error.to_string()))?;
        if config.calibration.as_os_str().is_empty() {
            config.calibration = path.with_extension("calibration.toml");
        } else if let Some(folder) = path.parent() {
            config.calibration = folder.join(&config.calibration);
        }
        config.check()?;
        Ok(config)
    }

    /// Whether every value is one that a robot may be run with.
    ///
    /// # Errors
    /// Names the first that is not.
    pub fn check(&self) -> Result<(), RigError> {
        if self.name.trim().is_empty() {
            return Err(RigError::Value("the rig has no name; give it one with name = \"…\"".into()));
        }
        self.limits.check_ranges()?;
        for (axis, limits) in self.axes().iter().enumerate() {
            let joint =
                if axis < WIRE_JOINTS { format!("joint {axis} of the hand") } else { "the rail".to_string() };
            limits.check().map_err(|message| RigError::Limits { joint, message })?;
        }
        let thumb = &JOINT_LIMITS_RAD[HAND_DRIVEN_JOINTS..];
        for (&angle, &[low, high]) in self.limits.thumb_rad.iter().zip(thumb) {
            check_range("limits.thumb_rad", angle, low..=high)?;
        }
        self.hand.check()?;
        self.joint_loop.check_ranges()?;
        self.arm.check()?;
        Ok(self.keyboard.check_ranges()?)
    }

    /// Limits of the set-points: the sixteen joints of the hand as on the wire, then the rail.
    pub fn axes(&self) -> [AxisLimits; WIRE_JOINTS + 1] {
        let limits = &self.limits;
        std::array::from_fn(|axis| match JOINT_LIMITS_RAD.get(axis) {
            Some(range) => AxisLimits {
                position: *range,
                velocity: limits.finger_velocity,
                acceleration: limits.finger_acceleration,
                jerk: limits.finger_jerk,
            },
            None => AxisLimits {
                position: limits.rail_range_m,
                velocity: limits.rail_velocity,
                acceleration: limits.rail_acceleration,
                jerk: limits.rail_jerk,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig() -> RigConfig {
        RigConfig { name: "lab".into(), ..RigConfig::default() }
    }

    #[test]
    fn ceilings_are_kept_and_named() {
        rig().check().unwrap();
        let refused = |text: &str| {
            let limits = toml::from_str(text).unwrap();
            RigConfig { limits, ..rig() }.check().unwrap_err().to_string()
        };
        let ceilings = [
            ("finger_velocity", 55.0),
            ("finger_acceleration", 5300.0),
            ("finger_jerk", 1_060_000.0),
            ("rail_velocity", 1.0),
            ("rail_acceleration", 14.0),
            ("rail_jerk", 5000.0),
            ("start_finger_rad", 0.5),
            ("start_rail_m", 0.05),
            ("stale_command_secs", 2.0),
            ("following_rad", 1.5),
            ("following_secs", 10.0),
        ];
        for (name, most) in ceilings {
            for value in [most * 1.001, 0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
                let said = refused(&format!("{name} = {value:?}").to_lowercase());
                assert!(said.starts_with(&format!("limits.{name} is")), "{name} = {value}: {said}");
            }
        }
        assert!(refused("rail_range_m = [-0.41, 0.3]").contains("-0.4 to 0.4"));
        assert!(refused("rail_range_m = [-0.3, 0.401]").contains("-0.4 to 0.4"));
        assert!(refused("calibration_days = 366").contains("365"));
        assert!(refused("finger_acceleration = 1.0").contains("joint 0 of the hand: stopping"));
        assert!(refused("rail_range_m = [0.1, 0.1]").contains("the rail: the position range"));
    }

    /// A rig's file may hold any number: it is refused or it works, and nothing panics.
    #[test]
    fn no_number_in_a_file_panics() {
        let text = toml::to_string(&rig()).unwrap();
        let odd =
            ["1e300", "-1e300", "1e-300", "nan", "inf", "-inf", "0.0", "0", "-1", "9223372036854775807"];
        let mut sound = 0;
        for (line, old) in text.lines().enumerate() {
            let Some((name, value)) = old.split_once(" = ") else { continue };
            if value.starts_with('"') {
                continue;
            }
            for value in odd {
                for many in
                    [value.to_string(), format!("[{value}, {value}]"), format!("[{}]", [value; 4].join(","))]
                {
                    let changed = format!("{name} = {many}");
                    let lines = text.lines().enumerate();
                    let text: Vec<&str> =
                        lines.map(|(at, old)| if at == line { changed.as_str() } else { old }).collect();
                    let Ok(config) = toml::from_str::<RigConfig>(&text.join("\n")) else { continue };
                    sound += usize::from(config.check().is_ok());
                }
            }
        }
        assert!(sound > 0);
    }
}
