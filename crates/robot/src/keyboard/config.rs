//! What can be set of the keyboard's driver, and the check of it.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::KEYS;

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
    /// The Keystation 49e as it is switched on (fact sheet hardware §3); no key of our songs is held for ten
    /// seconds.
    fn default() -> Self {
        Self { lowest_pitch: 36, stuck_after_secs: 10.0, sensing_timeout_secs: 0.3 }
    }
}

impl KeyboardConfig {
    /// The pitches of the keys and the two times, or what is wrong.
    pub(super) fn resolve(&self) -> Result<(u8, Duration, Duration), KeyboardConfigError> {
        if usize::from(self.lowest_pitch) + KEYS > 128 {
            return Err(KeyboardConfigError::LowestPitch { lowest_pitch: self.lowest_pitch });
        }
        let stuck_after = positive_secs("stuck_after_secs", self.stuck_after_secs)?;
        let sensing_timeout = positive_secs("sensing_timeout_secs", self.sensing_timeout_secs)?;
        Ok((self.lowest_pitch, stuck_after, sensing_timeout))
    }
}

/// The time of a setting, which must be positive and at most a day.
///
/// # Errors
/// If it is not.
pub fn positive_secs(name: &'static str, secs: f64) -> Result<Duration, KeyboardConfigError> {
    const DAY_SECS: f64 = 86_400.0;
    let time = Duration::try_from_secs_f64(secs).ok().filter(|time| !time.is_zero() && secs <= DAY_SECS);
    time.ok_or(KeyboardConfigError::Time { name, secs })
}

/// A setting of the keyboard or its emulator that makes no sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KeyboardConfigError {
    /// The rightmost key would have no MIDI number.
    #[error(
        "lowest_pitch = {lowest_pitch} puts the rightmost key beyond MIDI number 127; set it to at most 79 \
         (36 is usual)"
    )]
    LowestPitch {
        /// As set.
        lowest_pitch: u8,
    },
    /// A time is not a positive number of seconds.
    #[error("{name} = {secs} is no time; set it to seconds above 0 and at most 86400")]
    Time {
        /// Name of the setting.
        name: &'static str,
        /// As set.
        secs: f64,
    },
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
