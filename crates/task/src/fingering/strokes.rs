//! The song as strokes: which key goes down at which control step, and up at which.
//!
//! Strokes are read from the frames and not from the notes, because the frames are scored: they already contain the gap between two
//! strokes of one key.

use etude_music::KeySet;

/// One stroke: `key` sounds in the control steps `start..end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stroke {
    pub key: usize,
    pub start: usize,
    pub end: usize,
}

/// A moment at which at least one stroke begins, with all strokes that sound then.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Slice {
    pub start: usize,
    /// Indices of strokes, lowest key first.
    pub sounding: Vec<usize>,
}

/// All strokes in order of their beginning, lowest key first.
pub(crate) fn strokes(frames: &[KeySet]) -> Vec<Stroke> {
    let mut found = Vec::new();
    let mut before = KeySet::EMPTY;
    for (start, &now) in frames.iter().enumerate() {
        for key in now.difference(before).iter() {
            let length = frames[start..].iter().take_while(|frame| frame.contains(key)).count();
            found.push(Stroke { key, start, end: start + length });
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
        let strokes = strokes(&frames);
        let stroke = |key, start, end| Stroke { key, start, end };
        assert_eq!(strokes, [stroke(24, 1, 3), stroke(28, 2, 4), stroke(28, 5, 6)]);
        let sounding: Vec<_> =
            slices(&strokes).into_iter().map(|slice| (slice.start, slice.sounding)).collect();
        assert_eq!(sounding, [(1, vec![0]), (2, vec![0, 1]), (5, vec![2])]);
    }
}
