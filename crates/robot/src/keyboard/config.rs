//! What can be set of the keyboard's driver, and the check of it.

use etude_checks::{positive_to, settings};
use serde::{Deserialize, Serialize};

use super::KEY_COUNT;

/// Longest time of a setting, s.
const DAY_SECS: f64 = 86_400.0;
/// Highest MIDI number of the leftmost key: the rightmost must have one too.
pub const MAX_LOWEST_PITCH: f64 = (128 - KEY_COUNT) as f64;

settings! {
    /// What can be set of a [`Keyboard`](super::Keyboard).
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct KeyboardConfig("keyboard") {
        /// MIDI number of the leftmost key. The default is the Keystation 49e's as it is switched
        /// on.
        pub lowest_pitch: u8 = 36, 0.0..=MAX_LOWEST_PITCH;
        /// A key that stays down for longer than this raises a warning, in seconds. No note of our
        /// songs is held as long as the default.
        pub stuck_after_secs: f64 = 10.0, positive_to(DAY_SECS);
        /// A keyboard that once sent active sensing is lost after this much silence, in seconds.
        pub sensing_timeout_secs: f64 = 0.3, positive_to(DAY_SECS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_the_keystation_and_unknown_keys_are_refused() {
        let config: KeyboardConfig = toml::from_str("").unwrap();
        assert_eq!(config, KeyboardConfig::default());
        assert_eq!(config.check_ranges(), Ok(()));
        assert_eq!(config.lowest_pitch, 36);
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
            let error = toml::from_str::<KeyboardConfig>(config).unwrap().check_ranges().unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
        assert!(KeyboardConfig { lowest_pitch: 79, ..KeyboardConfig::default() }.check_ranges().is_ok());
    }
}
