//! What is true of a twin and hidden from whoever plays on it: its world's physical numbers, its drives, its wires.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use etude_robot::faults::{FaultPlan, FaultPlanError};
use etude_robot::keyboard;
use etude_robot::keyboard::KeyboardConfigError;
use etude_stage::{ParamError, PhysicalParams};
use serde::{Deserialize, Serialize};

/// The truth of one twin, one TOML file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Truth {
    /// Its name.
    pub name: String,
    /// Seed of its randomness: encoder noise and faulty links.
    pub seed: u64,
    /// Physical numbers of its world other than the defaults, by path.
    pub physics: BTreeMap<String, f64>,
    /// The hand.
    pub hand: HandTruth,
    /// The arm.
    pub arm: ArmTruth,
    /// The keyboard.
    pub keyboard: keyboard::EmulatorConfig,
    /// What happens on the wires.
    pub links: LinksTruth,
}

/// The truth of a hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandTruth {
    /// Torque at full duty, N·m.
    pub full_torque_nm: f64,
    /// Encoder readings are off by up to so many counts, evenly.
    pub noise_counts: u16,
    /// The hand's clock runs this much faster than the host's, as a share.
    pub clock_skew: f64,
    /// Torque is cut when no torque frame came for so long, s; none holds it for ever, as is to be expected.
    pub torque_timeout_secs: Option<f64>,
}

impl Default for HandTruth {
    fn default() -> Self {
        Self { full_torque_nm: 1.0, noise_counts: 1, clock_skew: 0.0, torque_timeout_secs: None }
    }
}

/// The truth of an arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ArmTruth {
    /// Time from a servo target's arrival until the joints know of it, s.
    pub delay_secs: f64,
    /// How fast the joints close in on a servo target, Hz.
    pub bandwidth_hz: f64,
    /// Stiffness of the hand's place along the keyboard, N/m.
    pub stiffness: f64,
    /// Damping of it, N·s/m.
    pub damping: f64,
}

impl Default for ArmTruth {
    fn default() -> Self {
        Self { delay_secs: 0.01, bandwidth_hz: 10.0, stiffness: 40_000.0, damping: 1000.0 }
    }
}

/// What happens on the wires, both ways alike.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LinksTruth {
    /// The hand's bus.
    pub can: FaultPlan,
    /// The arm's connections.
    pub arm: FaultPlan,
    /// The keyboard's line.
    pub midi: FaultPlan,
}

/// A truth that no twin can have.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// The file cannot be read.
    #[error("cannot read the truth {path}: {message}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// A physical number is unknown or out of range.
    #[error("the twin's physics: {0}")]
    Physics(#[from] ParamError),
    /// A number of a drive is out of range.
    #[error("the twin's {name} = {value} must lie in {low} … {high}")]
    OutOfRange {
        /// Which.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// The faults of a link make no sense.
    #[error("the twin's links: {0}")]
    Link(#[from] FaultPlanError),
    /// The keyboard's settings make no sense.
    #[error("the twin's keyboard: {0}")]
    Keyboard(#[from] KeyboardConfigError),
}

/// The truths that come with Étude, by name.
const BUILT_IN: [(&str, &str); 2] = [
    ("standard", include_str!("../../../configs/truths/standard.toml")),
    ("ideal", include_str!("../../../configs/truths/ideal.toml")),
];

impl Truth {
    /// The truth that is meant by `name`: a built-in one, or a file.
    ///
    /// # Errors
    /// If there is neither, or it is not sound.
    pub fn load(name: &str) -> Result<Self, TruthError> {
        let fail = |message: String| TruthError::Read { path: Path::new(name).to_path_buf(), message };
        let text = match BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
            Some((_, text)) => (*text).to_string(),
            None => std::fs::read_to_string(name).map_err(|error| {
                let known: Vec<_> = BUILT_IN.iter().map(|(name, _)| *name).collect();
                fail(format!("{error}; built in are {}", known.join(" and ")))
            })?,
        };
        let truth: Self = toml::from_str(&text).map_err(|error| fail(error.to_string()))?;
        truth.check()?;
        Ok(truth)
    }

    /// The physical numbers of its world.
    ///
    /// # Errors
    /// If a path is unknown or a value out of its range.
    pub fn params(&self) -> Result<PhysicalParams, ParamError> {
        let mut params = PhysicalParams::default();
        for (path, value) in &self.physics {
            params.set(path, *value)?;
        }
        Ok(params)
    }

    /// Whether a twin can have it; links and keyboard are checked where they are made.
    pub(crate) fn check(&self) -> Result<(), TruthError> {
        self.params()?;
        let (hand, arm) = (&self.hand, &self.arm);
        let rows = [
            ("hand.full_torque_nm", hand.full_torque_nm, 0.0, 10.0),
            ("hand.clock_skew", hand.clock_skew, -0.01, 0.01),
            ("hand.torque_timeout_secs", hand.torque_timeout_secs.unwrap_or(0.0), 0.0, 60.0),
            ("arm.delay_secs", arm.delay_secs, 0.0, 0.5),
            ("arm.bandwidth_hz", arm.bandwidth_hz, 0.5, 100.0),
            ("arm.stiffness", arm.stiffness, 100.0, 1e6),
            ("arm.damping", arm.damping, 1.0, 1e5),
        ];
        for (name, value, low, high) in rows {
            if !(low..=high).contains(&value) {
                return Err(TruthError::OutOfRange { name, value, low, high });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_in_truths_are_sound_and_named_as_they_are() {
        for (name, _) in BUILT_IN {
            assert_eq!(Truth::load(name).unwrap().name, name);
        }
        let missing = Truth::load("nowhere.toml").unwrap_err().to_string();
        assert!(missing.contains("nowhere.toml") && missing.contains("standard"), "{missing}");
    }

    #[test]
    fn nonsense_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.toml");
        let refused = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Truth::load(path.to_str().unwrap()).unwrap_err().to_string()
        };
        assert!(refused("[physics]\n\"key.weight\" = 1").contains("key.weight"));
        assert!(refused("[arm]\nbandwidth_hz = nan").contains("bandwidth_hz"));
        assert!(refused("colour = 1").contains("colour"));
    }
}
