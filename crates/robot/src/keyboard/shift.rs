//! Detects whether the keyboard is transposed. Its octave buttons send no message, so only notes
//! beyond its keys show it.

use std::fmt;

use super::KEY_COUNT;

/// By how much the notes of the keyboard are shifted, as far as the notes so far show.
///
/// The notes of an unshifted keyboard go from `lowest_pitch` to `lowest_pitch` + 48. A note beyond
/// them gives a lower bound of the shift; a note at the other end gives an upper bound. A shift
/// whose notes all happen to lie on the keyboard cannot be seen: press the lowest and the highest
/// key to be sure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shift {
    /// Lowest shift that explains every note so far, in semitones.
    pub lowest_semitones: i16,
    /// Highest shift that explains every note so far, in semitones.
    pub highest_semitones: i16,
    /// Note of the lowest key without shift.
    lowest_pitch: u8,
}

impl Shift {
    /// The bounds from one note.
    fn of(note: u8, lowest_pitch: u8) -> Self {
        let above_lowest = i16::from(note) - i16::from(lowest_pitch);
        Self {
            lowest_semitones: above_lowest - (KEY_COUNT as i16 - 1),
            highest_semitones: above_lowest,
            lowest_pitch,
        }
    }

    /// Whether no shift at all is ruled out.
    pub fn is_certain(&self) -> bool {
        self.lowest_semitones > 0 || self.highest_semitones < 0
    }

    /// The shift in semitones where the notes leave only one.
    pub fn exact_semitones(&self) -> Option<i16> {
        (self.lowest_semitones == self.highest_semitones).then_some(self.lowest_semitones)
    }

    /// The simplest explanation in semitones: whole octaves where they can be, as few as possible,
    /// otherwise the least transposition. Zero unless [`is_certain`](Self::is_certain).
    pub fn likely_semitones(&self) -> i16 {
        let (least, most, sign) = match (self.lowest_semitones, self.highest_semitones) {
            (lowest, highest) if lowest > 0 => (lowest, highest, 1),
            (lowest, highest) if highest < 0 => (-highest, -lowest, -1),
            _ => return 0,
        };
        let octaves = (least + 11) / 12 * 12;
        sign * if octaves <= most { octaves } else { least }
    }
}

impl fmt::Display for Shift {
    /// What was noticed, and which button to press how often.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let likely = self.likely_semitones();
        let (way, button) = if likely < 0 { ("down", '+') } else { ("up", '-') };
        let semitones = likely.unsigned_abs();
        let least = self.lowest_semitones.unsigned_abs().min(self.highest_semitones.unsigned_abs());
        let how_far = match self.exact_semitones() {
            Some(_) => format!("by {semitones} semitones"),
            None => format!("by at least {least} semitones, probably {semitones}"),
        };
        let remedy = match (semitones / 12, semitones % 12) {
            (1, 0) => format!("press its octave {button} button once"),
            (times, 0) => format!("press its octave {button} button {times} times"),
            _ => format!(
                "set its octave and transpose buttons back to 0 ({semitones} semitones too far {way})"
            ),
        };
        write!(
            f,
            "the keyboard is shifted {way} {how_far}: {remedy}, then press its lowest key, which must give \
             MIDI note {}",
            self.lowest_pitch
        )
    }
}

/// Collects the bounds of the shift from the notes.
#[derive(Clone, Debug)]
pub(super) struct ShiftWatch {
    lowest_pitch: u8,
    seen: Option<Shift>,
}

impl ShiftWatch {
    pub(super) fn new(lowest_pitch: u8) -> Self {
        Self { lowest_pitch, seen: None }
    }

    /// Forgets all notes: the buttons may have been pressed since.
    pub(super) fn restart(&mut self) {
        self.seen = None;
    }

    /// Takes a note into account; the shift once there is no doubt that there is one.
    pub(super) fn hear(&mut self, note: u8) -> Option<Shift> {
        let new = Shift::of(note, self.lowest_pitch);
        let both = self.seen.map(|old| Shift {
            lowest_semitones: old.lowest_semitones.max(new.lowest_semitones),
            highest_semitones: old.highest_semitones.min(new.highest_semitones),
            ..new
        });
        // No single shift explains all notes: a button was pressed in between, and only the newest
        // note counts.
        let shift = both.filter(|both| both.lowest_semitones <= both.highest_semitones).unwrap_or(new);
        self.seen = Some(shift);
        shift.is_certain().then_some(shift)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn heard(notes: &[u8]) -> Option<Shift> {
        let mut watch = ShiftWatch::new(36);
        notes.iter().fold(None, |_, &note| watch.hear(note))
    }

    #[test]
    fn the_keyboards_own_notes_raise_nothing() {
        for note in 36..=84 {
            assert_eq!(heard(&[note]), None);
        }
        assert_eq!(heard(&[36, 84, 60]), None);
    }

    #[test]
    fn the_message_says_which_button_and_how_often() {
        for (notes, words) in [
            (&[85][..], "up by at least 1 semitones, probably 12: press its octave - button once"),
            (&[97], "up by at least 13 semitones, probably 24: press its octave - button 2 times"),
            (&[35], "down by at least 1 semitones, probably 12: press its octave + button once"),
            (&[48, 96], "up by 12 semitones: press its octave - button once"),
            (&[24, 72], "down by 12 semitones: press its octave + button once"),
            (&[37, 85], "up by 1 semitones: set its octave and transpose buttons back to 0"),
        ] {
            let message = heard(notes).unwrap().to_string();
            assert!(message.contains(words), "{notes:?}: {message}");
            assert!(message.contains("MIDI note 36"), "{message}");
        }
    }

    #[test]
    fn a_button_pressed_in_between_is_noticed() {
        assert_eq!(heard(&[90, 36]), None, "shifted at first, then not");
        assert_eq!(heard(&[36, 84, 90]).unwrap().lowest_semitones, 6);
    }

    proptest! {
        #[test]
        fn the_true_shift_is_never_ruled_out(
            shift in -36_i16..=36, keys in prop::collection::vec(0_i16..49, 1..40),
        ) {
            let mut watch = ShiftWatch::new(36);
            for key in keys {
                let Ok(note) = u8::try_from(36 + shift + key) else { continue };
                if let Some(found) = watch.hear(note) {
                    let possible = found.lowest_semitones..=found.highest_semitones;
                    prop_assert!(possible.contains(&shift));
                    prop_assert!(possible.contains(&found.likely_semitones()));
                    prop_assert_ne!(found.likely_semitones(), 0);
                    prop_assert_ne!(shift, 0, "an unshifted keyboard is never accused");
                }
            }
        }
    }
}
