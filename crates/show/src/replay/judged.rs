//! The strokes of a take and its missed notes, judged as on the replay page
//! (`viewer/src/classify.js`).

use super::take::{Take, TakeNote};

/// How opaque the inside of a stroke out of time is.
pub(crate) const FILL_OF_OUT_OF_TIME: f64 = 0.35;
/// Colour of a key that is due.
pub(crate) const DUE_COLOUR: [u8; 3] = [0x56, 0xb4, 0xe9];

/// The judgement of a stroke or of a due note.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NoteJudgement {
    /// A stroke that plays a due note on time.
    Right,
    /// A stroke that plays a due note too early or too late.
    OutOfTime,
    /// A due note without a stroke.
    Missed,
    /// A stroke without a due note.
    Wrong,
    /// A stroke of a recording without due notes.
    Unjudged,
}

impl NoteJudgement {
    /// From the palette of Okabe and Ito, as on the replay page (`viewer/src/theme.js`).
    pub(crate) fn colour(self) -> [u8; 3] {
        match self {
            Self::Right => [0x00, 0x72, 0xb2],
            Self::OutOfTime => [0xcc, 0x79, 0xa7],
            Self::Missed => [0xd5, 0x5e, 0x00],
            Self::Wrong => [0xe6, 0x9f, 0x00],
            Self::Unjudged => [0x62, 0x65, 0x6b],
        }
    }
}

/// A stroke, as long as its key is held, or a missed note, as long as it is due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct JudgedNote {
    pub note: TakeNote,
    pub judgement: NoteJudgement,
}

impl Take {
    /// The strokes, and after them the missed notes.
    pub(crate) fn judged_notes(&self) -> Vec<JudgedNote> {
        let is_judged = !self.due_notes.is_empty() || self.due.iter().all(Vec::is_empty);
        let judgement = if is_judged { NoteJudgement::Wrong } else { NoteJudgement::Unjudged };
        let mut judged: Vec<JudgedNote> =
            self.notes.iter().map(|note| JudgedNote { note: *note, judgement }).collect();
        for (due, found) in self.due_notes.iter().zip(&self.matches) {
            match found {
                Some(found) if found.right => judged[found.note].judgement = NoteJudgement::Right,
                Some(found) => judged[found.note].judgement = NoteJudgement::OutOfTime,
                None => judged.push(JudgedNote { note: *due, judgement: NoteJudgement::Missed }),
            }
        }
        judged
    }

    /// The lowest and the highest pitch that is due or played.
    pub(crate) fn pitch_range(&self) -> Option<(u8, u8)> {
        let pitches = || self.due_notes.iter().chain(&self.notes).map(|note| note.pitch);
        Some((pitches().min()?, pitches().max()?))
    }
}
