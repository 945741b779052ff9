//! Which played note is which note of the song: the matching of `mir_eval`. Each pitch is matched
//! separately.

use crate::note::Note;

/// Onsets may differ by this much, in seconds. This tolerance and the next two are the defaults of
/// `mir_eval.transcription`.
pub(super) const ONSET_SECS: f64 = 0.05;
/// Releases may always differ by this much, in seconds …
const OFFSET_SECS: f64 = 0.05;
/// … and by this share of the length of the song's note, if that is more.
const OFFSET_RATIO: f64 = 0.2;

/// A note and its index in the caller's list.
type Indexed = (usize, Note);

/// The pairs by onset, at most `tolerance_secs` apart.
pub(super) fn pairs_within(tolerance_secs: f64, reference: &[Note], played: &[Note]) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    by_cluster(tolerance_secs, reference, played, |due, heard| {
        nearest_onsets(due, heard, tolerance_secs, &mut pairs);
    });
    pairs.sort_unstable();
    pairs
}

/// How many notes can be matched if the releases must match as well.
pub(super) fn matched_with_offset(reference: &[Note], played: &[Note]) -> usize {
    let mut matched = 0;
    by_cluster(ONSET_SECS, reference, played, |due, heard| matched += max_matching_size(due, heard));
    matched
}

/// Calls `each` with those notes of one pitch, sorted by onset, between which matches are possible.
fn by_cluster(
    tolerance_secs: f64,
    reference: &[Note],
    played: &[Note],
    mut each: impl FnMut(&[Indexed], &[Indexed]),
) {
    for pitch in 0..=u8::MAX {
        let strokes = |notes: &[Note]| {
            let of_pitch = notes.iter().copied().enumerate().filter(|(_, note)| note.pitch == pitch);
            let mut notes: Vec<Indexed> = of_pitch.collect();
            notes.sort_by(|(_, a), (_, b)| {
                a.start_secs.total_cmp(&b.start_secs).then(a.end_secs.total_cmp(&b.end_secs))
            });
            notes
        };
        let (due, heard) = (strokes(reference), strokes(played));
        for (due, heard) in clusters(&due, &heard, tolerance_secs) {
            each(due, heard);
        }
    }
}

/// Differences are rounded as in `mir_eval`, so that a note exactly at the tolerance is within it.
fn rounded(secs: f64) -> f64 {
    const STEPS_PER_SEC: f64 = 1e4;
    (secs * STEPS_PER_SEC).round_ties_even() / STEPS_PER_SEC
}

fn onsets_match(due: &Note, heard: &Note) -> bool {
    rounded((due.start_secs - heard.start_secs).abs()) <= ONSET_SECS
}

fn ends_match(due: &Note, heard: &Note) -> bool {
    let tolerance = (OFFSET_RATIO * due.duration_secs().abs()).max(OFFSET_SECS);
    rounded((due.end_secs - heard.end_secs).abs()) <= tolerance
}

/// Cuts two sorted lists where no match is possible across the cut: where the next onset of either
/// is too far away.
fn clusters<'a>(
    due: &'a [Indexed],
    heard: &'a [Indexed],
    tolerance_secs: f64,
) -> Vec<(&'a [Indexed], &'a [Indexed])> {
    let mut cut = Vec::new();
    let (mut d, mut h) = (0, 0);
    let (mut d0, mut h0) = (0, 0);
    let mut latest = f64::NEG_INFINITY;
    while d < due.len() || h < heard.len() {
        let next_due = due.get(d).map_or(f64::INFINITY, |(_, note)| note.start_secs);
        let next_heard = heard.get(h).map_or(f64::INFINITY, |(_, note)| note.start_secs);
        let next = next_due.min(next_heard);
        if rounded(next - latest) > tolerance_secs {
            cut.push((&due[d0..d], &heard[h0..h]));
            (d0, h0) = (d, h);
        }
        latest = next;
        // One of the two advances even if a time is not a number.
        let take_due = h == heard.len() || (d < due.len() && next_due <= next_heard);
        if take_due { d += 1 } else { h += 1 }
    }
    cut.push((&due[d0..], &heard[h0..]));
    cut.retain(|(due, heard)| !due.is_empty() && !heard.is_empty());
    cut
}

/// Matches onsets, as many as possible and then with the smallest sum of distances, and appends the
/// pairs. Along a line such a matching never crosses, so dynamic programming finds it.
fn nearest_onsets(due: &[Indexed], heard: &[Indexed], tolerance_secs: f64, pairs: &mut Vec<[usize; 2]>) {
    /// Pairs made, and their summed distance in seconds.
    type Cell = (usize, f64);
    if due.len().saturating_mul(heard.len()) > MAX_CELLS {
        return greedy_pairs(due, heard, tolerance_secs, pairs);
    }
    let better = |a: Cell, b: Cell| if (a.0, -a.1) >= (b.0, -b.1) { a } else { b };
    let width = heard.len() + 1;
    let mut best: Vec<Cell> = vec![(0, 0.0); (due.len() + 1) * width];
    let distance = |d: usize, h: usize| {
        let error = (heard[h].1.start_secs - due[d].1.start_secs).abs();
        (rounded(error) <= tolerance_secs).then_some(error)
    };
    for d in 1..=due.len() {
        for h in 1..=heard.len() {
            let mut cell = better(best[(d - 1) * width + h], best[d * width + h - 1]);
            if let Some(error) = distance(d - 1, h - 1) {
                let (pairs, sum) = best[(d - 1) * width + h - 1];
                cell = better((pairs + 1, sum + error), cell);
            }
            best[d * width + h] = cell;
        }
    }
    let (mut d, mut h) = (due.len(), heard.len());
    while d > 0 && h > 0 {
        let cell = best[d * width + h];
        if cell == best[(d - 1) * width + h] {
            d -= 1;
        } else if cell == best[d * width + h - 1] {
            h -= 1;
        } else {
            (d, h) = (d - 1, h - 1);
            pairs.push([due[d].0, heard[h].0]);
        }
    }
}

/// Largest table that is filled; no playable song comes near it.
const MAX_CELLS: usize = 1 << 22;

/// Matches as many onsets as possible, each with the first possible one.
fn greedy_pairs(due: &[Indexed], heard: &[Indexed], tolerance_secs: f64, pairs: &mut Vec<[usize; 2]>) {
    let (mut d, mut h) = (0, 0);
    while d < due.len() && h < heard.len() {
        let error = heard[h].1.start_secs - due[d].1.start_secs;
        if rounded(error.abs()) <= tolerance_secs {
            pairs.push([due[d].0, heard[h].0]);
            (d, h) = (d + 1, h + 1);
        } else if error < 0.0 {
            h += 1;
        } else {
            d += 1;
        }
    }
}

/// Size of a largest matching where releases must match as well, by augmenting paths (breadth
/// first).
fn max_matching_size(due: &[Indexed], heard: &[Indexed]) -> usize {
    // Notes are sorted by onset, so the candidates are consecutive; the window is a little wider
    // because of rounding.
    let candidates = |d: usize| {
        let start = due[d].1.start_secs;
        let first = heard.partition_point(|(_, note)| note.start_secs < start - ONSET_SECS * 1.01 - 1e-3);
        let matches =
            move |h: &usize| onsets_match(&due[d].1, &heard[*h].1) && ends_match(&due[d].1, &heard[*h].1);
        let window = heard[first..]
            .iter()
            .take_while(move |(_, note)| note.start_secs <= start + ONSET_SECS * 1.01 + 1e-3);
        (first..first + window.count()).filter(matches)
    };
    let mut partner_of_due: Vec<Option<usize>> = vec![None; due.len()];
    let mut partner_of_heard: Vec<Option<usize>> = vec![None; heard.len()];
    let mut pairs = 0;
    for free in 0..due.len() {
        let mut reached_from: Vec<Option<usize>> = vec![None; heard.len()];
        let mut queue = std::collections::VecDeque::from([free]);
        let mut open = None;
        'search: while let Some(d) = queue.pop_front() {
            for h in candidates(d) {
                if reached_from[h].is_none() {
                    reached_from[h] = Some(d);
                    match partner_of_heard[h] {
                        Some(next) => queue.push_back(next),
                        None => {
                            open = Some(h);
                            break 'search;
                        }
                    }
                }
            }
        }
        pairs += usize::from(open.is_some());
        while let Some(h) = open {
            let Some(d) = reached_from[h] else { break };
            partner_of_heard[h] = Some(d);
            open = partner_of_due[d].replace(h);
        }
    }
    pairs
}
