//! Two performances of one piece, note by note.

use anyhow::bail;
use etude_music::pitch_name;
use serde::Serialize;

use crate::replay::{Take, TakeNote};

/// Two performances, A and B, of one piece.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Each note that was due.
    pub notes: Vec<ComparedNote>,
    /// Wrong strokes of A and of B.
    pub strays: [Vec<TakeNote>; 2],
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
    /// Its strokes in A and B; none where it was missed.
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
    /// If one has no due notes, or they are not of the same song.
    pub fn new(a: &Take, b: &Take) -> anyhow::Result<Self> {
        for take in [a, b] {
            if take.due_notes.is_empty() {
                bail!("{} has no due notes: record a song with `etude play` or `etude perform`", take.name);
            }
        }
        if !a.has_the_notes_of(b) {
            bail!(
                "{} ({}) and {} ({}) are not of the same notes; compare performances of one song",
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
    let found = take.matches[index]?;
    let (due, played) = (take.due_notes[index], take.notes[found.note]);
    Some(Stroke {
        onset_error_secs: played.start - due.start,
        length_error_secs: (played.end - played.start) - (due.end - due.start),
        velocity: played.velocity,
        right: found.right,
    })
}

fn strays(take: &Take) -> Vec<TakeNote> {
    let plays_none = |index: usize| take.matches.iter().flatten().all(|found| found.note != index);
    take.notes.iter().enumerate().filter(|(index, _)| plays_none(*index)).map(|(_, note)| *note).collect()
}

#[cfg(test)]
mod tests {
    use etude_perform::{Activity, DueNote, Header, Recording};

    use super::*;

    /// A recording that nobody played, of notes that are due.
    fn take(song: &str, notes: &[(u8, f64)]) -> Take {
        let due = |(pitch, start_secs): &(u8, f64)| DueNote {
            pitch: *pitch,
            start_secs: *start_secs,
            end_secs: start_secs + 0.2,
            velocity: 80,
        };
        let due_notes: Vec<DueNote> = notes.iter().map(due).collect();
        let header = Header {
            control_hz: 20.0,
            activity: Activity::Rest,
            song: song.to_string(),
            due: vec![Vec::new(); 40],
            due_notes,
            ..Header::default()
        };
        Take::new(&Recording { header, complete: true, ..Recording::default() }, format!("{song}.mcap"))
            .unwrap()
    }

    #[test]
    fn two_songs_are_refused_also_if_their_pitches_are_the_same() {
        let one = take("One", &[(60, 1.0), (62, 1.5)]);
        let later = take("One", &[(60, 1.045), (62, 1.545)]);
        assert!(Comparison::new(&one, &later).is_ok(), "another latency compensation");
        for other in [&[(60, 1.0), (62, 2.0)][..], &[(60, 1.0), (64, 1.5)], &[(60, 1.0)]] {
            let refused = Comparison::new(&one, &take("Two", other)).unwrap_err().to_string();
            assert_eq!(
                refused,
                "One.mcap (One) and Two.mcap (Two) are not of the same notes; compare performances of one song"
            );
        }
        // The same notes under two titles are compared.
        let copy = take("Copy", &[(60, 1.0), (62, 1.5)]);
        assert!(Comparison::new(&one, &copy).is_ok());
    }
}
