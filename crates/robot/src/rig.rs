//! A rig: which devices there are, on which wires, and what they may do. One TOML file a rig.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::allegro::{HandConfig, HandConfigError, JOINT_LIMITS_RAD, JointLoopConfig, JointLoopError};
use crate::joints::{DRIVEN, FINGER_JOINTS, RAIL};
use crate::keyboard::{Keyboard, KeyboardConfig, KeyboardConfigError};
use crate::limiter::AxisLimits;
use crate::xarm::{ArmConfig, ArmConfigError};

/// Set-points per second: the physics steps of the simulator that a policy is trained in.
pub const SETPOINT_HZ: f64 = 200.0;

/// A rig as its file describes it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigConfig {
    /// Its name: calibrations and recordings carry it.
    pub name: String,
    /// Where the devices are.
    pub wires: WiresConfig,
    /// File of the keyboard's place, relative to the rig's file.
    pub calibration: PathBuf,
    /// What joints, rail and operator are held to.
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

/// Where the devices are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WiresConfig {
    /// The hand's bus: an interface such as `can0`, `slcan:/dev/ttyUSB0`, or `bus:SOCKET` of another process.
    pub can: String,
    /// The arm's address.
    pub arm: String,
    /// The keyboard: `alsa:NAME` (part of the port's name), `raw:DEVICE`, or `midi:SOCKET` of another process.
    pub midi: String,
}

impl Default for WiresConfig {
    /// As the devices come: the first CAN interface, the arm's address after a reset, the keyboard by its name.
    fn default() -> Self {
        Self { can: "can0".into(), arm: "192.168.1.111".into(), midi: "alsa:Keystation".into() }
    }
}

/// What joints, rail and operator are held to. Fingers: rad and s. Rail: m and s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsConfig {
    /// Largest speed of a finger joint's set-point, rad/s.
    pub finger_velocity: f64,
    /// Largest acceleration, rad/s².
    pub finger_acceleration: f64,
    /// Largest jerk, rad/s³.
    pub finger_jerk: f64,
    /// Part of the rail that may be used, m from the middle of the keyboard.
    pub rail_range_m: [f64; 2],
    /// Largest speed on the rail, m/s.
    pub rail_velocity: f64,
    /// Largest acceleration, m/s².
    pub rail_acceleration: f64,
    /// Largest jerk, m/s³.
    pub rail_jerk: f64,
    /// Where the thumb stays, rad.
    pub thumb_rad: [f64; 4],
    /// How far a finger joint may be from the first command, rad.
    pub start_finger_rad: f64,
    /// How far the hand may be from the first command, m.
    pub start_rail_m: f64,
    /// How long the last command stands without a new one before the robot is stopped, s.
    pub stale_command_secs: f64,
    /// Oldest calibration that is still trusted, days.
    pub calibration_days: u64,
}

impl Default for LimitsConfig {
    fn default() -> Self {
        Self {
            // The v4 description's velocity (fact sheet §1.4); acceleration and jerk are above what the simulated
            // fingers do in a song, so that mirroring them passes unchanged.
            finger_velocity: 7.0,
            finger_acceleration: 500.0,
            finger_jerk: 100_000.0,
            rail_range_m: [-0.337, 0.337],
            // 1.2 m/s is where the arm stops itself with error 60 (§2.5).
            rail_velocity: 0.8,
            // The arm's 1145 °/s² over the 2.57 rad that joint 4 turns a metre (§2.6, §2.12).
            rail_acceleration: 7.5,
            // The full acceleration in one set-point, as the arm itself would take it in servo mode.
            rail_jerk: 1500.0,
            // The authors' unused thumb (§0).
            thumb_rad: [0.363, 0.0, 0.0, 0.0],
            start_finger_rad: 0.2,
            start_rail_m: 0.01,
            // Three control steps.
            stale_command_secs: 0.15,
            calibration_days: 7,
        }
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
    /// The hand's settings are not sound.
    #[error(transparent)]
    Hand(#[from] HandConfigError),
    /// The joint loop's gains are not sound.
    #[error(transparent)]
    JointLoop(#[from] JointLoopError),
    /// The arm's settings are not sound.
    #[error(transparent)]
    Arm(#[from] ArmConfigError),
    /// The keyboard's settings are not sound.
    #[error(transparent)]
    Keyboard(#[from] KeyboardConfigError),
}

impl RigConfig {
    /// Reads and checks a rig's file. The path of the calibration becomes one from the working folder.
    ///
    /// # Errors
    /// If the file cannot be read, names something unknown, or asks for what the devices cannot bear.
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
        for (joint, limits) in self.axes().iter().enumerate() {
            let name = if joint == DRIVEN { "the rail".into() } else { format!("finger joint {joint}") };
            limits.check().map_err(|message| RigError::Limits { joint: name, message })?;
        }
        let limits = &self.limits;
        let positive = [
            ("start_finger_rad", limits.start_finger_rad),
            ("start_rail_m", limits.start_rail_m),
            ("stale_command_secs", limits.stale_command_secs),
        ];
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(RigError::Value(format!("limits.{name} is {value}: set it above 0")));
            }
        }
        for (angle, [low, high]) in limits.thumb_rad.iter().zip(&JOINT_LIMITS_RAD[FINGER_JOINTS..]) {
            if !(low..=high).contains(&angle) {
                return Err(RigError::Value(format!(
                    "limits.thumb_rad has {angle}, and this joint goes from {low} to {high} rad"
                )));
            }
        }
        self.hand.check()?;
        self.joint_loop.check()?;
        self.arm.check()?;
        Keyboard::new(&self.keyboard)?;
        Ok(())
    }

    /// Limits of the set-points: the sixteen joints of the hand as on the wire, then the rail.
    pub fn axes(&self) -> [AxisLimits; crate::allegro::JOINTS + 1] {
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

// The driven joints are those of the first three fingers and the rail.
const _: () = assert!(RAIL == FINGER_JOINTS && DRIVEN == FINGER_JOINTS + 1);
