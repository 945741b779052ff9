//! The song as strokes: which key goes down at which control step, and up at which.
//!
//! Strokes are read from the frames and not from the notes, because the frames are scored: they already contain the gap between two
//! strokes of one key.

use etude_music::{CONTROL_HZ, KeySet, LOWEST_PITCH, Note};

/// Velocity of a key that is due without a note, which only tests make.
const UNKNOWN_VELOCITY: u8 = 64;

/// One stroke: `key` sounds in the control steps `start..end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stroke {
    pub key: usize,
    pub start: usize,
    pub end: usize,
    /// MIDI velocity.
    pub velocity: u8,
}

/// A moment at which at least one stroke begins, with all strokes that sound then.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Slice {
    pub start: usize,
    /// Indices of strokes, lowest key first.
    pub sounding: Vec<usize>,
}

/// All strokes in order of their beginning, lowest key first. Each has the velocity of the note of its key that begins
/// nearest; notes are later than frames by `latency_compensation_secs`.
pub(crate) fn strokes(frames: &[KeySet], notes: &[Note], latency_compensation_secs: f64) -> Vec<Stroke> {
    let velocity = |key: usize, start: usize| {
        let away =
            |note: &&Note| (note.start_secs - latency_compensation_secs - start as f64 / CONTROL_HZ).abs();
        let of_key = notes.iter().filter(|note| usize::from(note.pitch) == key + usize::from(LOWEST_PITCH));
        of_key.min_by(|a, b| away(a).total_cmp(&away(b))).map_or(UNKNOWN_VELOCITY, |note| note.velocity)
    };
    let mut found = Vec::new();
    let mut before = KeySet::EMPTY;
    for (start, &now) in frames.iter().enumerate() {
        for key in now.difference(before).iter() {
            let length = frames[start..].iter().take_while(|frame| frame.contains(key)).count();
            let (end, velocity) = (start + length, velocity(key, start));
            found.push(Stroke { key, start, end, velocity });
        }
        before = now;
    }
    found
}

/// The moments at which strokes begin.
pub(crate) fn slices(strokes: &[Stroke]) -> Vec<Slice> {
    let mut starts: Vec<usize> = strokes.iter().map(|stroke| stroke.start).collect();
    starts.dedup();
    let sounds = |stroke: &Stroke, step: usize| (stroke.start..stroke.end).contains(&step);
    let mut slices: Vec<Slice> = Vec::with_capacity(starts.len());
    let mut first = 0;
    for start in starts {
        let sounding = (first..strokes.len())
            .take_while(|index| strokes[*index].start <= start)
            .filter(|index| sounds(&strokes[*index], start));
        let mut sounding: Vec<usize> = sounding.collect();
        first = sounding.first().copied().unwrap_or(first);
        sounding.sort_by_key(|index| strokes[*index].key);
        slices.push(Slice { start, sounding });
    }
    slices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_become_strokes_and_slices() {
        let frames: Vec<KeySet> = [&[][..], &[60], &[60, 64], &[64], &[], &[64]]
            .map(|p| KeySet::from_pitches(p.iter().copied()))
            .into();
        let note =
            |pitch, start_secs, velocity| Note { pitch, velocity, start_secs, end_secs: start_secs + 0.1 };
        let notes =
            |lead: f64| [note(60, 0.06 + lead, 50), note(64, 0.26 + lead, 90), note(64, 0.11 + lead, 70)];
        // A lead of more than half of the time between two strokes of a key does not exchange their velocities.
        let led = strokes(&frames, &notes(0.115), 0.115);
        let strokes = strokes(&frames, &notes(0.0), 0.0);
        assert_eq!(led, strokes);
        let stroke = |key, start, end, velocity| Stroke { key, start, end, velocity };
        assert_eq!(strokes, [stroke(24, 1, 3, 50), stroke(28, 2, 4, 70), stroke(28, 5, 6, 90)]);
        let sounding: Vec<_> =
            slices(&strokes).into_iter().map(|slice| (slice.start, slice.sounding)).collect();
        assert_eq!(sounding, [(1, vec![0]), (2, vec![0, 1]), (5, vec![2])]);
    }
}
