//! Songs with notes outside the keyboard, and the transpositions that make them fit.

use std::fmt::Write;

use thiserror::Error;

use crate::keys::{HIGHEST_PITCH, LOWEST_PITCH, pitch_name};
use crate::meter::Position;
use crate::note::Note;

/// A note outside the keyboard.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct OffendingNote {
    /// The note.
    pub note: Note,
    /// Where in the score it starts.
    pub position: Position,
}

/// A song with notes outside the keyboard.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{}", self.message())]
pub struct OutOfRange {
    /// Title of the song.
    pub title: String,
    /// Every note outside the keyboard, in order of time.
    pub notes: Vec<OffendingNote>,
    /// Every transposition in semitones that brings the whole song onto the keyboard, lowest first;
    /// empty if the song is wider than the keyboard.
    pub transpositions: Vec<i32>,
}

/// Positions that a message lists for one pitch; the rest are counted.
const MAX_POSITIONS: usize = 6;
const OCTAVE: i32 = 12;

impl OutOfRange {
    fn message(&self) -> String {
        let mut text = format!(
            "\"{}\" has notes outside the keyboard, which reaches from {} ({LOWEST_PITCH}) to {} ({HIGHEST_PITCH}):",
            self.title,
            pitch_name(LOWEST_PITCH),
            pitch_name(HIGHEST_PITCH),
        );
        let mut pitches: Vec<u8> = self.notes.iter().map(|offending| offending.note.pitch).collect();
        pitches.sort_unstable();
        pitches.dedup();
        for pitch in pitches {
            let positions: Vec<_> =
                self.notes.iter().filter(|offending| offending.note.pitch == pitch).collect();
            let _ = write!(text, "\n  {} ({pitch}) at", pitch_name(pitch));
            for (i, one) in positions.iter().take(MAX_POSITIONS).enumerate() {
                let comma = if i == 0 { "" } else { ";" };
                let _ = write!(text, "{comma} {} ({:.2} s)", one.position, one.note.start_secs);
            }
            if positions.len() > MAX_POSITIONS {
                let _ = write!(text, " and {} more", positions.len() - MAX_POSITIONS);
            }
        }
        text + "\n" + &self.advice()
    }

    fn advice(&self) -> String {
        let by = |semitones: &i32| format!("{semitones:+}");
        let (Some(lowest), Some(highest)) = (self.transpositions.first(), self.transpositions.last()) else {
            return "No transposition makes it fit: the song spans more than the keyboard. Without these notes: \
                    `etude songs arrange FILE.mid --within-range -o NEW.mid`."
                .into();
        };
        let mut text = if lowest == highest {
            format!("Transpose it by {} semitones to make it fit", by(lowest))
        } else {
            format!("Transpose it by any of {} to {} semitones to make it fit", by(lowest), by(highest))
        };
        let octaves = || self.transpositions.iter().filter(|s| *s % OCTAVE == 0);
        if octaves().next().is_some() {
            let names: Vec<String> = octaves().map(by).collect();
            let _ = write!(text, "; {} keeps its key", names.join(" or "));
        }
        let nearest =
            octaves().min_by_key(|s| s.abs()).or(self.transpositions.iter().min_by_key(|s| s.abs()));
        let nearest = nearest.unwrap_or(lowest);
        format!("{text}: `etude songs arrange FILE.mid --transpose {nearest} -o NEW.mid`.")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::SongError;
    use crate::song::Song;

    fn song(pitches: &[u8]) -> Song {
        let note = |(i, &pitch): (usize, &u8)| Note {
            pitch,
            velocity: 64,
            start_secs: i as f64 * 0.5,
            end_secs: i as f64 * 0.5 + 0.4,
        };
        Song::new("Too wide", pitches.iter().enumerate().map(note).collect(), 0.0).unwrap()
    }

    #[test]
    fn the_message_names_notes_positions_and_remedies() {
        let error = song(&[60, 96, 72, 35, 60, 96]).check_range().unwrap_err().to_string();
        assert_eq!(
            error,
            "\"Too wide\" has notes outside the keyboard, which reaches from C2 (36) to C6 (84):\n\
             \x20 B1 (35) at bar 1, beat 4 (1.50 s)\n\
             \x20 C7 (96) at bar 1, beat 2 (0.50 s); bar 2, beat 2 (2.50 s)\n\
             No transposition makes it fit: the song spans more than the keyboard. Without these notes: `etude songs arrange FILE.mid --within-range -o NEW.mid`."
        );
        let error = song(&[60, 96]).check_range().unwrap_err().to_string();
        assert!(
            error.ends_with(
                "Transpose it by any of -24 to -12 semitones to make it fit; -24 or -12 keeps its key: `etude songs arrange FILE.mid --transpose -12 -o NEW.mid`."
            ),
            "{error}"
        );
    }

    #[test]
    fn the_transpositions_offered_fit_and_no_others_do() {
        for pitches in [vec![35, 60], vec![90, 50], vec![20, 20], vec![36, 85], vec![37, 85]] {
            let song = song(&pitches);
            let Err(SongError::OutOfRange(out)) = song.check_range() else { panic!("{pitches:?} fits") };
            for semitones in -128..=128 {
                let fits = song.transpose(semitones).is_ok_and(|song| song.check_range().is_ok());
                assert_eq!(fits, out.transpositions.contains(&semitones), "{pitches:?} by {semitones}");
            }
        }
    }

    #[test]
    fn a_song_on_the_keyboard_passes() {
        song(&[LOWEST_PITCH, HIGHEST_PITCH]).check_range().unwrap();
    }
}
