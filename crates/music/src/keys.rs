//! Numbering of the keys, and sets of keys.
//!
//! A set of keys is the state of the keyboard or one frame of a song. It is one machine word, so
//! that sets are compared by bit operations.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Number of keys (M-Audio Keystation 49e: 29 white and 20 black).
pub const KEY_COUNT: usize = 49;
/// MIDI pitch of the leftmost key without octave shift, as in
/// github.com/lasr-lab/learning-to-play-piano.
pub const LOWEST_PITCH: u8 = 36;
/// MIDI pitch of the rightmost key.
pub const HIGHEST_PITCH: u8 = 84;

const ALL: u64 = (1 << KEY_COUNT) - 1;
const SEMITONES: u8 = 12;
const NAMES: [&str; SEMITONES as usize] = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"];

/// Whether `key` (index from the left) is a black one.
pub fn key_is_black(key: usize) -> bool {
    NAMES[(key + usize::from(LOWEST_PITCH)) % usize::from(SEMITONES)].len() > 1
}

/// Scientific name of a MIDI pitch, sharps for the black keys: 60 is `C4`, middle C.
pub fn pitch_name(pitch: u8) -> String {
    let octave = i32::from(pitch / SEMITONES) - 1;
    format!("{}{octave}", NAMES[usize::from(pitch % SEMITONES)])
}

/// A set of keys: bit *i* stands for key *i*, whose pitch is [`LOWEST_PITCH`] + *i*.
///
/// Bits at [`KEY_COUNT`] and above are never set by the methods here.
#[derive(Copy, Clone, Debug, Default, Eq, PartialEq, Ord, PartialOrd, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct KeySet(pub u64);

impl KeySet {
    /// No key.
    pub const EMPTY: KeySet = KeySet(0);

    /// The keys of these MIDI pitches; pitches off the keyboard are left out.
    pub fn from_pitches(pitches: impl IntoIterator<Item = u8>) -> KeySet {
        pitches.into_iter().filter_map(key_of_pitch).collect()
    }

    /// Adds a key; true if it was not there before.
    ///
    /// # Panics
    /// If `key` is not below [`KEY_COUNT`]. For pitches from outside, use [`KeySet::from_pitches`].
    pub fn insert(&mut self, key: usize) -> bool {
        assert!(key < KEY_COUNT, "key {key} is off the keyboard of {KEY_COUNT} keys");
        let before = self.0;
        self.0 |= 1 << key;
        before != self.0
    }

    /// Takes a key out; true if it was there.
    pub fn remove(&mut self, key: usize) -> bool {
        let there = self.contains(key);
        if there {
            self.0 &= !(1 << key);
        }
        there
    }

    /// Whether the key is in the set.
    pub fn contains(self, key: usize) -> bool {
        key < KEY_COUNT && self.0 >> key & 1 == 1
    }

    /// Key indices from left to right.
    pub fn iter(self) -> impl Iterator<Item = usize> + Clone {
        let mut left = self.0 & ALL;
        std::iter::from_fn(move || {
            (left != 0).then(|| {
                let key = left.trailing_zeros() as usize;
                left &= left - 1;
                key
            })
        })
    }

    /// MIDI pitches from left to right.
    pub fn pitches(self) -> impl Iterator<Item = u8> + Clone {
        self.iter().map(|key| LOWEST_PITCH + key as u8)
    }

    /// How many keys.
    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether there is no key at all.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Keys in both sets.
    #[must_use]
    pub fn intersection(self, other: KeySet) -> KeySet {
        KeySet(self.0 & other.0)
    }

    /// Keys in this set that the other one lacks.
    #[must_use]
    pub fn difference(self, other: KeySet) -> KeySet {
        KeySet(self.0 & !other.0)
    }
}

impl FromIterator<usize> for KeySet {
    fn from_iter<I: IntoIterator<Item = usize>>(keys: I) -> KeySet {
        let mut set = KeySet::EMPTY;
        for key in keys {
            set.insert(key);
        }
        set
    }
}

impl fmt::Display for KeySet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, pitch) in self.pitches().enumerate() {
            let gap = if i == 0 { "" } else { " " };
            write!(f, "{gap}{pitch}")?;
        }
        Ok(())
    }
}

/// The key of a MIDI pitch, if the keyboard has it.
pub(crate) fn key_of_pitch(pitch: u8) -> Option<usize> {
    (LOWEST_PITCH..=HIGHEST_PITCH).contains(&pitch).then(|| usize::from(pitch - LOWEST_PITCH))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_keyboard_has_twenty_black_keys_and_ends_on_cs() {
        assert_eq!((0..KEY_COUNT).filter(|&key| key_is_black(key)).count(), 20);
        assert_eq!(usize::from(HIGHEST_PITCH - LOWEST_PITCH) + 1, KEY_COUNT);
        assert_eq!(pitch_name(LOWEST_PITCH), "C2");
        assert_eq!(pitch_name(60), "C4");
        assert_eq!(pitch_name(70), "A#4");
        assert_eq!(pitch_name(0), "C-1");
        assert_eq!(pitch_name(127), "G9");
        assert!(key_is_black(1) && !key_is_black(4) && !key_is_black(5));
    }

    #[test]
    fn a_set_prints_its_pitches() {
        let set = KeySet::from_pitches([64, 60, 67, 12, 90]);
        assert_eq!(set.to_string(), "60 64 67");
        assert_eq!(KeySet::EMPTY.to_string(), "");
        assert_eq!(serde_json::to_string(&KeySet(5)).unwrap(), "5");
    }
}
