//! One note, and the rule that notes of one pitch do not overlap.
//!
//! In a score two voices may hold the same pitch at once, but a keyboard has one key for it.
//! Overlaps are removed when a song is made, so that frames, metrics, MIDI files and sound use the
//! same notes.

use serde::{Deserialize, Serialize};

/// A key struck, held and released.
#[derive(Copy, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Note {
    /// MIDI number; 60 is middle C.
    pub pitch: u8,
    /// MIDI velocity, 1 to 127.
    pub velocity: u8,
    /// When the key goes down, in seconds from the start of the song.
    pub start_secs: f64,
    /// When the key comes up, in seconds; never before the start.
    pub end_secs: f64,
}

impl Note {
    /// How long the key is held, in seconds.
    pub fn duration_secs(&self) -> f64 {
        self.end_secs - self.start_secs
    }
}

/// Notes that begin within this time form a chord, s.
const CHORD_SECS: f64 = 0.005;

/// The chords of notes that are in order of their onsets.
pub fn chords(notes: &[Note]) -> impl Iterator<Item = &[Note]> {
    notes.chunk_by(|one, next| next.start_secs - one.start_secs < CHORD_SECS)
}

/// Onsets of one pitch closer than this are one stroke, s: far below a MIDI tick of any real file.
const SAME_STROKE_SECS: f64 = 1e-6;

/// Removes overlaps of notes of one pitch, and sorts the notes by start, then pitch.
///
/// Where notes of one pitch overlap, each ends where the next begins, and the last one at the
/// latest end. Notes of one pitch that begin together become one with the greater velocity.
pub(crate) fn without_overlaps(mut notes: Vec<Note>) -> Vec<Note> {
    notes.sort_by(|a, b| a.pitch.cmp(&b.pitch).then(a.start_secs.total_cmp(&b.start_secs)));
    let mut separate: Vec<Note> = Vec::with_capacity(notes.len());
    for mut note in notes {
        if let Some(last) = separate.last_mut().filter(|last| last.pitch == note.pitch) {
            if note.start_secs - last.start_secs <= SAME_STROKE_SECS {
                last.velocity = last.velocity.max(note.velocity);
                last.end_secs = last.end_secs.max(note.end_secs);
                continue;
            }
            if note.start_secs < last.end_secs {
                note.end_secs = note.end_secs.max(last.end_secs);
                last.end_secs = note.start_secs;
            }
        }
        separate.push(note);
    }
    separate.sort_by(|a, b| a.start_secs.total_cmp(&b.start_secs).then(a.pitch.cmp(&b.pitch)));
    separate
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(pitch: u8, start_secs: f64, end_secs: f64) -> Note {
        Note { pitch, velocity: 64, start_secs, end_secs }
    }

    #[test]
    fn an_overlap_is_struck_anew_and_held_to_the_latest_end() {
        let notes = without_overlaps(vec![note(60, 0.0, 4.0), note(60, 1.0, 2.0), note(62, 0.5, 3.0)]);
        assert_eq!(notes, [note(60, 0.0, 1.0), note(62, 0.5, 3.0), note(60, 1.0, 4.0)]);
    }

    #[test]
    fn a_unison_is_one_note() {
        let loud = Note { velocity: 100, ..note(60, 0.0, 1.0) };
        let notes = without_overlaps(vec![loud, note(60, 0.0, 2.0), note(60, 0.0, 0.0)]);
        assert_eq!(notes, [Note { velocity: 100, ..note(60, 0.0, 2.0) }]);
    }

    #[test]
    fn touching_notes_stay_as_they_are() {
        let notes = vec![note(60, 0.0, 1.0), note(60, 1.0, 2.0)];
        assert_eq!(without_overlaps(notes.clone()), notes);
    }
}
