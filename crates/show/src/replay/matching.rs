//! Matching of the played notes with the due ones.

use std::collections::BTreeSet;

use etude_music::Note;
use etude_music::metrics::matched_notes;
use serde::Serialize;

/// A stroke this near to a due note of its pitch is that note, played early or late, s.
const SAME_NOTE_SECS: f64 = 0.5;

/// The stroke by which a due note was played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct NoteMatch {
    /// Index of the played note.
    pub note: usize,
    /// Whether its onset is within the tolerance of the scores; else it is the nearest unmatched
    /// stroke of the pitch.
    pub right: bool,
}

/// The stroke of each due note; `None` for a missed one.
pub(super) fn match_notes(due: &[Note], played: &[Note]) -> Vec<Option<NoteMatch>> {
    let mut matches = vec![None; due.len()];
    let mut left: BTreeSet<usize> = (0..played.len()).collect();
    for [index, note] in matched_notes(due, played) {
        matches[index] = Some(NoteMatch { note, right: true });
        left.remove(&note);
    }
    for (due, found) in due.iter().zip(&mut matches).filter(|(_, found)| found.is_none()) {
        let away = |note: &usize| (played[*note].start_secs - due.start_secs).abs();
        let near = |note: &&usize| played[**note].pitch == due.pitch && away(note) <= SAME_NOTE_SECS;
        let nearest = left.iter().filter(near).min_by(|a, b| away(a).total_cmp(&away(b))).copied();
        if let Some(note) = nearest {
            left.remove(&note);
            *found = Some(NoteMatch { note, right: false });
        }
    }
    matches
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
        let right = |note| Some(NoteMatch { note, right: true });
        let off = |note| Some(NoteMatch { note, right: false });
        // The second is nearer to the stroke before it than to the one after it.
        assert_eq!(match_notes(&due, &played), [right(0), off(4), None, None]);
        // One stroke plays one note.
        assert_eq!(match_notes(&due[..2], &played[..1]), [right(0), None]);
    }
}
