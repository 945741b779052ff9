//! Warnings about moments of a song that the hand cannot play as written.
//!
//! The hand plays with three fingers; the thumb is not used. The fingers have a fixed spacing, each
//! can lean a little to the left and to the right, and the rail moves all of them together. So keys
//! that sound together must match the spacing of the fingers within that range. A song with
//! warnings can still be learned; the policy plays what it can.

use std::fmt;

use crate::CONTROL_HZ;
use crate::keys::pitch_name;
use crate::meter::Position;
use crate::note::Note;
use crate::song::Song;

/// Fingers that press keys: index, middle and ring (the paper's hand leaves the thumb unused).
pub const PLAYING_FINGERS: usize = 3;
/// Distance between neighbouring fingertips at rest, in millimetres (palm of the Allegro hand).
pub const FINGER_SPACING_MM: f64 = 43.5;
/// How far a fingertip can move laterally to press the middle of a key, in millimetres to each
/// side. Estimated: the finger's first joint turns it about its own axis, which moves a curled
/// fingertip sideways by about a quarter of the spacing.
pub const FINGER_LATERAL_RANGE_MM: f64 = 12.0;
/// Width of the keyboard over its number of white keys, in millimetres: 674 mm for 29, as measured
/// in github.com/lasr-lab/learning-to-play-piano.
pub const WHITE_KEY_PITCH_MM: f64 = 674.0 / 29.0;

/// Notes that sound together for less than this, in seconds, are legato and not a chord: one
/// control step.
const CHORD_SECS: f64 = 1.0 / CONTROL_HZ;

/// Why a moment of a song cannot be played as written.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum WarningKind {
    /// More notes at once than playing fingers.
    TooManyNotes,
    /// The fingers cannot reach these keys at once.
    OutOfReach,
    /// A key is struck again too soon: it cannot be up for long enough in between.
    QuickRepeat,
}

/// A moment that the hand cannot play as written.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    /// Why.
    pub kind: WarningKind,
    /// The MIDI pitches that should sound together, lowest first.
    pub pitches: Vec<u8>,
    /// When, in seconds.
    pub start_secs: f64,
    /// Where in the score.
    pub position: Position,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<String> = self.pitches.iter().map(|&pitch| pitch_name(pitch)).collect();
        write!(f, "{} ({:.2} s): {} ", self.position, self.start_secs, names.join(" "))?;
        match self.kind {
            WarningKind::TooManyNotes => {
                write!(f, "are {} notes at once for {PLAYING_FINGERS} fingers", names.len())
            }
            WarningKind::OutOfReach => {
                write!(f, "cannot be reached together: the fingers are too close or too far apart for them")
            }
            WarningKind::QuickRepeat => {
                write!(f, "is struck again before the key has been up for long enough")
            }
        }
    }
}

/// Lateral position of the middle of a key, in millimetres from an arbitrary origin. A black key is
/// taken to lie on the border between its white neighbours.
pub fn key_centre_mm(pitch: u8) -> f64 {
    const HALF_WHITES: [i32; 12] = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12];
    const HALF_WHITES_AN_OCTAVE: i32 = 14;
    let halves = i32::from(pitch / 12) * HALF_WHITES_AN_OCTAVE + HALF_WHITES[usize::from(pitch % 12)];
    f64::from(halves) / 2.0 * WHITE_KEY_PITCH_MM
}

/// Whether the playing fingers can reach all of these keys at once; pitches lowest first.
pub(crate) fn within_reach(pitches: &[u8]) -> bool {
    // Which finger takes which key: every way to choose as many fingers, in order, as there are
    // keys.
    (0u32..1 << PLAYING_FINGERS).filter(|fingers| fingers.count_ones() as usize == pitches.len()).any(
        |fingers| {
            let chosen = (0..PLAYING_FINGERS).filter(|finger| fingers >> finger & 1 == 1);
            // Where the rail would have to be for each finger to be straight; they must agree
            // within that range.
            let rail = pitches
                .iter()
                .zip(chosen)
                .map(|(&pitch, f)| key_centre_mm(pitch) - f as f64 * FINGER_SPACING_MM);
            let (low, high) = rail.fold((f64::MAX, f64::MIN), |(low, high), mm| (low.min(mm), high.max(mm)));
            high - low <= 2.0 * FINGER_LATERAL_RANGE_MM
        },
    )
}

impl Song {
    /// Moments that the hand cannot play as written: more notes at once than fingers, and chords
    /// out of reach. One warning an onset, in order of time.
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let mut held: Vec<Note> = Vec::new();
        for chord in self.notes().chunk_by(|a, b| b.start_secs - a.start_secs < CHORD_SECS / 2.0) {
            let (Some(first), Some(last)) = (chord.first(), chord.last()) else { continue };
            held.retain(|note| note.end_secs - last.start_secs >= CHORD_SECS);
            held.extend(chord.iter().filter(|note| note.end_secs >= last.start_secs));
            let mut pitches: Vec<u8> = held.iter().map(|note| note.pitch).collect();
            pitches.sort_unstable();
            pitches.dedup();
            let kind = match pitches.len() {
                0 | 1 => continue,
                n if n > PLAYING_FINGERS => WarningKind::TooManyNotes,
                _ if !within_reach(&pitches) => WarningKind::OutOfReach,
                _ => continue,
            };
            let start_secs = first.start_secs;
            warnings.push(Warning { kind, pitches, start_secs, position: self.position(start_secs) });
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_follows_the_spacing_of_the_fingers() {
        for chord in
            [&[60, 64][..], &[65, 69, 72], &[67, 71, 74], &[60, 64, 67], &[60, 62], &[60, 65], &[60, 67]]
        {
            assert!(within_reach(chord), "{chord:?}");
        }
        for chord in
            [&[60, 61][..], &[61, 62], &[60, 69], &[60, 72], &[60, 61, 64], &[60, 62, 64], &[60, 67, 72]]
        {
            assert!(!within_reach(chord), "{chord:?}");
        }
    }

    #[test]
    fn keys_have_their_lateral_positions() {
        for (low, high, whites) in [(60, 61, 0.5), (64, 65, 1.0), (59, 60, 1.0), (36, 84, 28.0)] {
            let span = (key_centre_mm(high) - key_centre_mm(low)) / WHITE_KEY_PITCH_MM;
            assert!((span - whites).abs() < 1e-9, "{low} {high}: {span}");
        }
    }

    #[test]
    fn warnings_say_what_and_where() {
        let note = |pitch, start_secs, end_secs| Note { pitch, velocity: 64, start_secs, end_secs };
        let notes = vec![
            note(60, 0.0, 0.52), // legato into the next: no chord
            note(61, 0.5, 1.0),
            note(48, 2.0, 3.0),
            note(72, 2.0, 3.0),
            note(60, 4.0, 6.0),
            note(64, 4.0, 6.0),
            note(67, 4.0, 6.0),
            note(71, 5.0, 6.0),
        ];
        let warnings = Song::new("", notes, 0.0).unwrap().warnings();
        let texts: Vec<String> = warnings.iter().map(Warning::to_string).collect();
        assert_eq!(
            texts,
            [
                "bar 2, beat 1 (2.00 s): C3 C5 cannot be reached together: the fingers are too close or too far apart \
                 for them",
                "bar 3, beat 3 (5.00 s): C4 E4 G4 B4 are 4 notes at once for 3 fingers",
            ]
        );
    }
}
