//! Music written as text, for songs in source code.
//!
//! Tokens are separated by spaces: a pitch with its octave (`C4`, `Bb4`, `F#5`), several joined by
//! `+` for a chord, or `-` for a rest; `>` for an accent; then, unless it lasts one beat, a colon
//! and its length in beats. `|` ends a bar. The lengths of bars are checked; a short first bar is a
//! pickup, and the last bar may be short. `pp`, `p`, `mp`, `mf`, `f` and `ff` say how loud what
//! follows is; `mf` before the first of them.
//!
//! ```
//! let song = etude_music::notation::read("Lullaby", "C4 D4:.5 E4:.5 C4+G4:2 | - G4:3", 0.5, 4)?;
//! assert_eq!(song.notes().len(), 6);
//! assert_eq!(song.duration_secs(), 4.0);
//! # Ok::<(), etude_music::SongError>(())
//! ```

use crate::error::SongError;
use crate::meter::BeatGrid;
use crate::note::Note;
use crate::song::{MAX_VELOCITY, Song};

/// MIDI velocities of the dynamic marks, as MuseScore plays them.
const DYNAMICS: [(&str, u8); 6] = [("pp", 33), ("p", 49), ("mp", 64), ("mf", 80), ("f", 96), ("ff", 112)];
/// How loud music without marks is.
const MEZZO_FORTE: u8 = DYNAMICS[3].1;
/// How much louder an accent is: one mark.
const ACCENT: u8 = 16;
/// Lengths are decimal fractions of a beat; sums of them are compared to this, in beats.
const BEAT_TOLERANCE: f64 = 1e-6;

/// Reads written music with beats of `beat_secs` seconds and bars of `beats_per_bar` beats.
///
/// # Errors
/// If a token cannot be read or a bar does not add up; the token is named.
pub fn read(title: &str, music: &str, beat_secs: f64, beats_per_bar: u8) -> Result<Song, SongError> {
    let mut notes = Vec::new();
    let mut beat = 0.0;
    let mut bar_began = 0.0;
    let mut pickup = None;
    let mut velocity = MEZZO_FORTE;
    for (index, text) in music.split_whitespace().enumerate() {
        let wrong = |why: &str| {
            SongError::Invalid(format!("in the written music, token {} (`{text}`): {why}", index + 1))
        };
        if text == "|" {
            let length = beat - bar_began;
            let short_first = pickup.is_none() && length < f64::from(beats_per_bar);
            if (length - f64::from(beats_per_bar)).abs() > BEAT_TOLERANCE && !short_first {
                return Err(wrong("the bar before this line does not have as many beats as a bar should"));
            }
            pickup.get_or_insert(if short_first { length } else { 0.0 });
            bar_began = beat;
            continue;
        }
        if let Some((_, marked)) = DYNAMICS.iter().find(|(mark, _)| *mark == text) {
            velocity = *marked;
            continue;
        }
        let (sound, length) = text.split_once(':').unwrap_or((text, "1"));
        let length: f64 = length.parse().map_err(|_| wrong("its length is not a number of beats"))?;
        if !(length > 0.0 && length.is_finite()) {
            return Err(wrong("its length must be above zero"));
        }
        let (sound, velocity) = match sound.strip_suffix('>') {
            Some(accented) => (accented, velocity.saturating_add(ACCENT).min(MAX_VELOCITY)),
            None => (sound, velocity),
        };
        if sound != "-" {
            for name in sound.split('+') {
                let pitch =
                    pitch(name).ok_or_else(|| wrong("a pitch is a letter, perhaps # or b, and an octave"))?;
                let (start_secs, end_secs) = (beat * beat_secs, (beat + length) * beat_secs);
                notes.push(Note { pitch, velocity, start_secs, end_secs });
            }
        }
        beat += length;
    }
    let beats = BeatGrid::regular(beat_secs, beats_per_bar, pickup.unwrap_or(0.0));
    Ok(Song::new(title, notes, beat * beat_secs)?.with_beats(beats))
}

/// MIDI number of a scientific pitch name.
fn pitch(name: &str) -> Option<u8> {
    let mut letters = name.chars();
    let step = match letters.next()? {
        'C' => 0,
        'D' => 2,
        'E' => 4,
        'F' => 5,
        'G' => 7,
        'A' => 9,
        'B' => 11,
        _ => return None,
    };
    let rest = letters.as_str();
    let (alteration, octave) = match rest.strip_prefix('#') {
        Some(octave) => (1, octave),
        None => rest.strip_prefix('b').map_or((0, rest), |octave| (-1, octave)),
    };
    let octave: i32 = octave.parse().ok().filter(|octave| (-1..=9).contains(octave))?;
    u8::try_from((octave + 1) * 12 + step + alteration).ok().filter(|pitch| *pitch < 128)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_agree() {
        assert_eq!((0..128).filter(|&midi| pitch(&crate::pitch_name(midi)) == Some(midi)).count(), 128);
        assert_eq!(pitch("Bb4"), Some(70));
        for bad in ["", "H4", "C", "C44", "c4", "G#9", "Cb-1", "C#", "Dé"] {
            assert_eq!(pitch(bad), None, "{bad}");
        }
    }

    #[test]
    fn marks_and_accents_say_how_loud() {
        let song = read("", "C4 p D4 E4+G4>:2 | ff F4> F4:3", 1.0, 4).unwrap();
        let velocities: Vec<_> = song.notes().iter().map(|note| note.velocity).collect();
        assert_eq!(velocities, [80, 49, 65, 65, 127, 112]);
    }

    #[test]
    fn mistakes_are_found() {
        for (music, token) in
            [("C4 X4", 2), ("C4:0", 1), ("C4:x", 1), ("C4:4 | D4:3 | E4", 4), ("C4:5 |", 2), ("C4:NaN", 1)]
        {
            let error = read("", music, 1.0, 4).unwrap_err();
            assert!(error.to_string().contains(&format!("token {token} ")), "{music}: {error}");
        }
    }

    #[test]
    fn a_short_first_bar_is_a_pickup() {
        let song = read("", "C4 | D4:3 | E4:2", 1.0, 3).unwrap();
        assert_eq!(song.position(0.0).to_string(), "bar 0, beat 3");
        assert_eq!(song.position(1.0).to_string(), "bar 1, beat 1");
    }
}
