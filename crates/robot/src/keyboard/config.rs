//! What can be set of the keyboard's driver, and the check of it.

use std::time::Duration;

use etude_checks::{RangeError, check_range, positive_to};
use serde::{Deserialize, Serialize};

use super::KEY_COUNT;

/// Longest time of a setting, s.
const DAY_SECS: f64 = 86_400.0;

/// What can be set of a [`Keyboard`](super::Keyboard).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KeyboardConfig {
    /// MIDI number of the leftmost key.
    pub lowest_pitch: u8,
    /// A key that stays down for longer than this raises a warning, in seconds.
    pub stuck_after_secs: f64,
    /// A keyboard that once sent active sensing is lost after this much silence, in seconds.
    pub sensing_timeout_secs: f64,
}

impl Default for KeyboardConfig {
    /// The Keystation 49e as it is switched on; no note of our songs is held for ten seconds.
    fn default() -> Self {
        Self { lowest_pitch: 36, stuck_after_secs: 10.0, sensing_timeout_secs: 0.3 }
    }
}

impl KeyboardConfig {
    /// The MIDI number of the leftmost key and the two times.
    ///
    /// # Errors
    /// Names the first setting that is out of its range.
    pub(super) fn resolve(&self) -> Result<(u8, Duration, Duration), RangeError> {
        check_lowest_pitch(self.lowest_pitch)?;
        let stuck_after = positive_secs("keyboard.stuck_after_secs", self.stuck_after_secs)?;
        let sensing_timeout = positive_secs("keyboard.sensing_timeout_secs", self.sensing_timeout_secs)?;
        Ok((self.lowest_pitch, stuck_after, sensing_timeout))
    }
}

/// Checks that the rightmost key has a MIDI number.
///
/// # Errors
/// If not.
pub fn check_lowest_pitch(pitch: u8) -> Result<(), RangeError> {
    check_range("keyboard.lowest_pitch", pitch.into(), 0.0..=(128 - KEY_COUNT) as f64)
}

/// The time of a setting, which must be positive and at most a day.
///
/// # Errors
/// If it is not.
pub fn positive_secs(name: &str, secs: f64) -> Result<Duration, RangeError> {
    check_range(name, secs, positive_to(DAY_SECS))?;
    Ok(Duration::from_secs_f64(secs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_the_keystation_and_unknown_keys_are_refused() {
        let config: KeyboardConfig = toml::from_str("").unwrap();
        assert_eq!(config, KeyboardConfig::default());
        assert_eq!(config.resolve().unwrap(), (36, Duration::from_secs(10), Duration::from_millis(300)));
        assert!(toml::from_str::<KeyboardConfig>("lowest_note = 36").is_err());
    }

    #[test]
    fn nonsense_is_refused() {
        for (config, word) in [
            ("lowest_pitch = 80", "lowest_pitch"),
            ("stuck_after_secs = 0", "stuck_after_secs"),
            ("sensing_timeout_secs = -0.1", "sensing_timeout_secs"),
            ("sensing_timeout_secs = nan", "sensing_timeout_secs"),
            ("stuck_after_secs = inf", "stuck_after_secs"),
        ] {
            let error = toml::from_str::<KeyboardConfig>(config).unwrap().resolve().unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
        assert!(KeyboardConfig { lowest_pitch: 79, ..KeyboardConfig::default() }.resolve().is_ok());
    }
}
