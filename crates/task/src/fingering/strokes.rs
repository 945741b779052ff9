//! The song as strokes: which key goes down at which control step, and up at which.
//!
//! Strokes are read from the frames and not from the notes, because the frames are scored: they
//! already contain the gap between two strokes of one key.

use etude_music::{CONTROL_HZ, KeySet, LOWEST_PITCH, Note};

/// Velocity of a key that is due without a note, which only tests make.
const UNKNOWN_VELOCITY: u8 = 64;

/// One stroke: `key` sounds in the control steps `start..end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stroke {
    pub key: usize,
    pub start: usize,
    pub end: usize,
    /// MIDI velocity.
    pub velocity: u8,
}

/// A control step in which at least one stroke begins, with all strokes that sound in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Onset {
    pub start: usize,
    /// Indices of strokes, lowest key first.
    pub sounding: Vec<usize>,
}

/// The strokes of a piece, for which a fingering is planned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Strokes {
    /// In order of their beginning, lowest key first.
    pub(super) strokes: Vec<Stroke>,
    /// Notes of the song.
    pub(super) notes: usize,
    /// Control steps of the piece.
    pub(super) steps: usize,
}

impl Strokes {
    /// The strokes of these frames. Each has the velocity of the note of its key that begins
    /// nearest; notes are later than frames by `latency_compensation_secs`.
    pub fn new(frames: &[KeySet], notes: &[Note], latency_compensation_secs: f64) -> Self {
        let velocity = |key: usize, start: usize| {
            let start_secs = start as f64 / CONTROL_HZ;
            let distance = |note: &&Note| (note.start_secs - latency_compensation_secs - start_secs).abs();
            let of_key =
                notes.iter().filter(|note| usize::from(note.pitch) == key + usize::from(LOWEST_PITCH));
            let nearest = of_key.min_by(|a, b| distance(a).total_cmp(&distance(b)));
            nearest.map_or(UNKNOWN_VELOCITY, |note| note.velocity)
        };
        let mut strokes = Vec::new();
        let mut before = KeySet::EMPTY;
        for (start, &now) in frames.iter().enumerate() {
            for key in now.difference(before).iter() {
                let length = frames[start..].iter().take_while(|frame| frame.contains(key)).count();
                strokes.push(Stroke { key, start, end: start + length, velocity: velocity(key, start) });
            }
            before = now;
        }
        Self { strokes, notes: notes.len(), steps: frames.len() }
    }

    /// The control steps in which strokes begin.
    pub(super) fn onsets(&self) -> Vec<Onset> {
        let strokes = &self.strokes;
        let mut starts: Vec<usize> = strokes.iter().map(|stroke| stroke.start).collect();
        starts.dedup();
        let mut onsets: Vec<Onset> = Vec::with_capacity(starts.len());
        let mut first = 0;
        for start in starts {
            let mut sounding: Vec<usize> = (first..strokes.len())
                .take_while(|index| strokes[*index].start <= start)
                .filter(|index| strokes[*index].end > start)
                .collect();
            first = sounding.first().copied().unwrap_or(first);
            sounding.sort_by_key(|index| strokes[*index].key);
            onsets.push(Onset { start, sounding });
        }
        onsets
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_become_strokes_and_onsets() {
        let frames: Vec<KeySet> = [&[][..], &[60], &[60, 64], &[64], &[], &[64]]
            .map(|p| KeySet::from_pitches(p.iter().copied()))
            .into();
        let note =
            |pitch, start_secs, velocity| Note { pitch, velocity, start_secs, end_secs: start_secs + 0.1 };
        let notes =
            |late: f64| [note(60, 0.06 + late, 50), note(64, 0.26 + late, 90), note(64, 0.11 + late, 70)];
        // Compensation of more than half of the time between two strokes of a key does not exchange
        // their velocities.
        let compensated = Strokes::new(&frames, &notes(0.115), 0.115);
        let strokes = Strokes::new(&frames, &notes(0.0), 0.0);
        assert_eq!(compensated, strokes);
        let stroke = |key, start, end, velocity| Stroke { key, start, end, velocity };
        assert_eq!(strokes.strokes, [stroke(24, 1, 3, 50), stroke(28, 2, 4, 70), stroke(28, 5, 6, 90)]);
        let sounding: Vec<_> =
            strokes.onsets().into_iter().map(|onset| (onset.start, onset.sounding)).collect();
        assert_eq!(sounding, [(1, vec![0]), (2, vec![0, 1]), (5, vec![2])]);
    }
}
