//! The notes of a performance beside those that were due.

use std::collections::BTreeSet;

use etude_music::Note;
use etude_music::metrics::matched_notes;
use serde::Serialize;

/// A stroke this far from a due note of its pitch is that note played early or late, and not another one, s.
const SAME_NOTE_SECS: f64 = 0.5;

/// The stroke by which a due note was played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Heard {
    /// Index of the played note.
    pub note: usize,
    /// Whether its onset is near enough for the scores; else it is the nearest stroke of the pitch that is left over.
    pub right: bool,
}

/// By which stroke each due note was played; `None` for a missed one.
pub(super) fn heard(due: &[Note], played: &[Note]) -> Vec<Option<Heard>> {
    let mut heard = vec![None; due.len()];
    let mut left: BTreeSet<usize> = (0..played.len()).collect();
    for [index, note] in matched_notes(due, played) {
        heard[index] = Some(Heard { note, right: true });
        left.remove(&note);
    }
    for (due, heard) in due.iter().zip(&mut heard).filter(|(_, heard)| heard.is_none()) {
        let away = |note: &usize| (played[*note].start_secs - due.start_secs).abs();
        let near = |note: &&usize| played[**note].pitch == due.pitch && away(note) <= SAME_NOTE_SECS;
        let nearest = left.iter().filter(near).min_by(|a, b| away(a).total_cmp(&away(b))).copied();
        if let Some(note) = nearest {
            left.remove(&note);
            *heard = Some(Heard { note, right: false });
        }
    }
    heard
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(pitch: u8, start_secs: f64) -> Note {
        Note { pitch, velocity: 64, start_secs, end_secs: start_secs + 0.3 }
    }

    #[test]
    fn a_due_note_is_right_late_or_missed() {
        let due = [note(60, 1.0), note(60, 2.0), note(64, 3.0), note(65, 4.0)];
        let played = [note(60, 1.02), note(60, 2.3), note(64, 3.9), note(66, 4.0), note(60, 1.9)];
        let right = |note| Some(Heard { note, right: true });
        let off = |note| Some(Heard { note, right: false });
        // The second is nearer to the stroke before it than to the one after it.
        assert_eq!(heard(&due, &played), [right(0), off(4), None, None]);
        // One stroke plays one note.
        assert_eq!(heard(&due[..2], &played[..1]), [right(0), None]);
    }
}
