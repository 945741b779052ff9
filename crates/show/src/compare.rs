//! Two performances of one piece, note by note.

use anyhow::bail;
use etude_music::pitch_name;
use serde::Serialize;

use crate::replay::{PlayedNote, Take};

/// Two performances, A and B, of one piece.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Each note that was due.
    pub notes: Vec<ComparedNote>,
    /// Strokes of A and of B that play no due note.
    pub strays: [Vec<PlayedNote>; 2],
}

/// A due note in both performances.
#[derive(Clone, Debug, Serialize)]
pub struct ComparedNote {
    /// MIDI number.
    pub pitch: u8,
    /// Its name, such as `C4`.
    pub name: String,
    /// When it is due in A, s.
    pub due_secs: f64,
    /// How A and B played it; none where it was missed.
    pub played: [Option<Stroke>; 2],
}

/// How a due note was played.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Stroke {
    /// Played minus due onset, s; late is positive.
    pub onset_error_secs: f64,
    /// Played minus due length, s.
    pub length_error_secs: f64,
    /// MIDI velocity.
    pub velocity: u8,
    /// Whether the onset is near enough to count as right.
    pub right: bool,
}

impl Comparison {
    /// Compares two performances.
    ///
    /// # Errors
    /// If one has no notes that were due, or they are not of the same piece.
    pub fn new(a: &Take, b: &Take) -> anyhow::Result<Self> {
        for take in [a, b] {
            if take.due_notes.is_empty() {
                bail!(
                    "{} does not say which notes were due: it has no song, or an older Étude has written it; make it again with \
                     `etude play` or `etude perform`",
                    take.name
                );
            }
        }
        if !a.has_the_notes_of(b) {
            bail!(
                "{} ({}) and {} ({}) are not of the same notes; compare performances of one piece",
                a.name,
                a.song,
                b.name,
                b.song
            );
        }
        let notes = a.due_notes.iter().enumerate().map(|(index, due)| ComparedNote {
            pitch: due.pitch,
            name: pitch_name(due.pitch),
            due_secs: due.start,
            played: [stroke(a, index), stroke(b, index)],
        });
        Ok(Self { notes: notes.collect(), strays: [strays(a), strays(b)] })
    }
}

fn stroke(take: &Take, index: usize) -> Option<Stroke> {
    let heard = take.heard[index]?;
    let (due, played) = (take.due_notes[index], take.notes[heard.note]);
    Some(Stroke {
        onset_error_secs: played.start - due.start,
        length_error_secs: (played.end - played.start) - (due.end - due.start),
        velocity: played.velocity,
        right: heard.right,
    })
}

fn strays(take: &Take) -> Vec<PlayedNote> {
    let plays_none = |index: usize| take.heard.iter().flatten().all(|heard| heard.note != index);
    take.notes.iter().enumerate().filter(|(index, _)| plays_none(*index)).map(|(_, note)| *note).collect()
}
