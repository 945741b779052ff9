//! Scores by note: played notes matched with the notes of the song, and their onset errors.
//!
//! The measure is that of music transcription, as the `mir_eval` package computes it. Played notes are matched to the song's, one to one
//! and as many as possible, if the pitch is the same and the onset is near; in the stricter variant the release must be near too.
//! Each pitch is matched separately.

use serde::{Deserialize, Serialize};

use super::share;
use crate::note::Note;

/// Onsets may differ by this much, in seconds. This tolerance and the next two are the defaults of `mir_eval.transcription`.
const ONSET_SECS: f64 = 0.05;
/// Releases may always differ by this much, in seconds …
const OFFSET_SECS: f64 = 0.05;
/// … and by this share of the length of the song's note, if that is more.
const OFFSET_RATIO: f64 = 0.2;

/// Scores of a performance by note. Precision, recall and F1 are from 0 to 1, and 0 where the song or the
/// performance has no notes, as in `mir_eval`.
#[derive(Copy, Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoteScores {
    /// Share of the played notes that match one of the song by pitch and onset.
    pub onset_precision: f64,
    /// Share of the song's notes that were matched by pitch and onset.
    pub onset_recall: f64,
    /// Harmonic mean of the two.
    pub onset_f1: f64,
    /// As `onset_precision`, with the release near as well.
    pub onset_offset_precision: f64,
    /// As `onset_recall`, with the release near as well.
    pub onset_offset_recall: f64,
    /// Harmonic mean of the two.
    pub onset_offset_f1: f64,
    /// Median of played minus due onset over the notes matched by onset, in seconds; late is positive. None
    /// without a match.
    pub onset_error_median_secs: Option<f64>,
    /// Distance between the quartiles of the same errors, in seconds.
    pub onset_error_iqr_secs: Option<f64>,
    /// Size of these errors, whether early or late, that 95 % of them do not exceed, in seconds.
    pub onset_error_p95_secs: Option<f64>,
    /// Their mean, in seconds: the bias.
    pub onset_error_mean_secs: Option<f64>,
    /// Correlation (Pearson's) of played and due MIDI velocities over the notes matched by onset. None where either is the same for
    /// all of them.
    pub velocity_correlation: Option<f64>,
    /// Notes matched by pitch and onset.
    pub matched: usize,
    /// Notes of the song that were not.
    pub missed: usize,
    /// Played notes that match none.
    pub wrong: usize,
}

/// Scores played notes against those of the song. The time grows with the square of the number of strokes of one pitch that follow
/// each other within the tolerance.
pub fn note_scores(reference: &[Note], played: &[Note]) -> NoteScores {
    let (pairs, with_offset) = matchings(reference, played);
    let matched = pairs.len();
    let mut errors: Vec<f64> =
        pairs.iter().map(|[due, heard]| played[*heard].start_secs - reference[*due].start_secs).collect();
    errors.sort_by(f64::total_cmp);
    let mut sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let of = |sorted: &[f64], q| (matched > 0).then(|| quantile(sorted, q));
    let iqr = of(&errors, 0.75).zip(of(&errors, 0.25)).map(|(upper, lower)| upper - lower);
    let [onset_precision, onset_recall, onset_f1] = rates(matched, reference.len(), played.len());
    let [onset_offset_precision, onset_offset_recall, onset_offset_f1] =
        rates(with_offset, reference.len(), played.len());
    NoteScores {
        onset_precision,
        onset_recall,
        onset_f1,
        onset_offset_precision,
        onset_offset_recall,
        onset_offset_f1,
        onset_error_median_secs: of(&errors, 0.5),
        onset_error_iqr_secs: iqr,
        onset_error_p95_secs: of(&sizes, 0.95),
        onset_error_mean_secs: (matched > 0).then(|| errors.iter().sum::<f64>() / matched as f64),
        velocity_correlation: velocity_correlation(&pairs, reference, played),
        matched,
        missed: reference.len() - matched,
        wrong: played.len() - matched,
    }
}

/// Pairs of a note of the song and the played note that matches it by pitch and onset, as indices into the two lists, in the order of
/// the song's.
///
/// Of all largest matchings, it is the one with the smallest sum of onset errors.
pub fn matched_notes(reference: &[Note], played: &[Note]) -> Vec<[usize; 2]> {
    matchings(reference, played).0
}

/// A note and its index in the caller's list.
type Indexed = (usize, Note);

/// The pairs by onset, and how many could be matched if the releases must be near as well.
fn matchings(reference: &[Note], played: &[Note]) -> (Vec<[usize; 2]>, usize) {
    let mut pairs = Vec::new();
    let mut with_offset = 0;
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
        for (due, heard) in clusters(&due, &heard) {
            nearest_onsets(due, heard, &mut pairs);
            with_offset += most_pairs(due, heard);
        }
    }
    pairs.sort_unstable();
    (pairs, with_offset)
}

fn rates(matched: usize, reference: usize, played: usize) -> [f64; 3] {
    let (precision, recall) = (share(matched, played, 0.0), share(matched, reference, 0.0));
    [precision, recall, share(2 * matched, reference + played, 0.0)]
}

/// Differences are rounded as in `mir_eval`, so that a note exactly at the tolerance is within it.
fn rounded(secs: f64) -> f64 {
    const STEPS_PER_SEC: f64 = 1e4;
    (secs * STEPS_PER_SEC).round_ties_even() / STEPS_PER_SEC
}

fn onsets_near(due: &Note, heard: &Note) -> bool {
    rounded((due.start_secs - heard.start_secs).abs()) <= ONSET_SECS
}

fn ends_near(due: &Note, heard: &Note) -> bool {
    let tolerance = (OFFSET_RATIO * due.duration_secs().abs()).max(OFFSET_SECS);
    rounded((due.end_secs - heard.end_secs).abs()) <= tolerance
}

/// Cuts two sorted lists where no match is possible across the cut: where the next onset of either is too far away.
fn clusters<'a>(due: &'a [Indexed], heard: &'a [Indexed]) -> Vec<(&'a [Indexed], &'a [Indexed])> {
    let mut cut = Vec::new();
    let (mut d, mut h) = (0, 0);
    let (mut d0, mut h0) = (0, 0);
    let mut latest = f64::NEG_INFINITY;
    while d < due.len() || h < heard.len() {
        let next_due = due.get(d).map_or(f64::INFINITY, |(_, note)| note.start_secs);
        let next_heard = heard.get(h).map_or(f64::INFINITY, |(_, note)| note.start_secs);
        let next = next_due.min(next_heard);
        if rounded(next - latest) > ONSET_SECS {
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

/// Matches onsets, as many as possible and then with the smallest sum of distances, and appends the pairs. Along a line such a
/// matching never crosses, so dynamic programming finds it.
fn nearest_onsets(due: &[Indexed], heard: &[Indexed], pairs: &mut Vec<[usize; 2]>) {
    /// Pairs made, and their summed distance in seconds.
    type Cell = (usize, f64);
    if due.len().saturating_mul(heard.len()) > MAX_CELLS {
        return first_come(due, heard, pairs);
    }
    let better = |a: Cell, b: Cell| if (a.0, -a.1) >= (b.0, -b.1) { a } else { b };
    let width = heard.len() + 1;
    let mut best: Vec<Cell> = vec![(0, 0.0); (due.len() + 1) * width];
    let distance = |d: usize, h: usize| {
        let error = (heard[h].1.start_secs - due[d].1.start_secs).abs();
        (rounded(error) <= ONSET_SECS).then_some(error)
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
fn first_come(due: &[Indexed], heard: &[Indexed], pairs: &mut Vec<[usize; 2]>) {
    let (mut d, mut h) = (0, 0);
    while d < due.len() && h < heard.len() {
        let error = heard[h].1.start_secs - due[d].1.start_secs;
        if rounded(error.abs()) <= ONSET_SECS {
            pairs.push([due[d].0, heard[h].0]);
            (d, h) = (d + 1, h + 1);
        } else if error < 0.0 {
            h += 1;
        } else {
            d += 1;
        }
    }
}

/// Size of a largest matching where releases must be near as well, by augmenting paths (breadth first).
fn most_pairs(due: &[Indexed], heard: &[Indexed]) -> usize {
    // Notes are sorted by onset, so the candidates are consecutive; the window is a little wider because of rounding.
    let candidates = |d: usize| {
        let start = due[d].1.start_secs;
        let first = heard.partition_point(|(_, note)| note.start_secs < start - ONSET_SECS * 1.01 - 1e-3);
        let near_enough =
            move |h: &usize| onsets_near(&due[d].1, &heard[*h].1) && ends_near(&due[d].1, &heard[*h].1);
        let window = heard[first..]
            .iter()
            .take_while(move |(_, note)| note.start_secs <= start + ONSET_SECS * 1.01 + 1e-3);
        (first..first + window.count()).filter(near_enough)
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

fn velocity_correlation(pairs: &[[usize; 2]], reference: &[Note], played: &[Note]) -> Option<f64> {
    let velocities = |of: fn([Note; 2]) -> Note| -> Vec<f64> {
        let notes = pairs.iter().map(|[due, heard]| of([reference[*due], played[*heard]]));
        let values: Vec<f64> = notes.map(|note| f64::from(note.velocity)).collect();
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        values.iter().map(|value| value - mean).collect()
    };
    let (due, heard) = (velocities(|[due, _]| due), velocities(|[_, heard]| heard));
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let spread = (product(&due, &due) * product(&heard, &heard)).sqrt();
    // Velocities are whole numbers, so that any difference is far above rounding.
    (spread > 1e-6).then(|| product(&due, &heard) / spread)
}

/// Linear interpolation between order statistics, as numpy's default; the list is sorted and not empty.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let place = q * (sorted.len() - 1) as f64;
    let (below, above) = (place.floor() as usize, place.ceil() as usize);
    sorted[below] + (sorted[above] - sorted[below]) * (place - place.floor())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strokes(starts: &[f64]) -> Vec<Note> {
        let note =
            |&start_secs: &f64| Note { pitch: 60, velocity: 64, start_secs, end_secs: start_secs + 0.1 };
        starts.iter().map(note).collect()
    }

    #[test]
    fn errors_come_from_the_nearest_of_the_largest_matchings() {
        // Taking the nearest first would leave a note over; the largest matching pairs both.
        let scores = note_scores(&strokes(&[1.0, 1.04]), &strokes(&[0.96, 1.01]));
        assert_eq!((scores.matched, scores.missed, scores.wrong), (2, 0, 0));
        assert!((scores.onset_error_mean_secs.unwrap() + 0.035).abs() < 1e-12);
        assert_eq!(matched_notes(&strokes(&[1.0, 1.04]), &strokes(&[0.96, 1.01])), [[0, 0], [1, 1]]);
        assert_eq!(matched_notes(&strokes(&[2.0, 1.0]), &strokes(&[1.01, 9.0, 2.0])), [[0, 2], [1, 0]]);
        // Two ways to match one: the nearer counts.
        let scores = note_scores(&strokes(&[1.0]), &strokes(&[0.97, 1.01]));
        assert_eq!((scores.matched, scores.wrong), (1, 1));
        assert!((scores.onset_error_median_secs.unwrap() - 0.01).abs() < 1e-12);
    }

    #[test]
    fn exactly_at_the_tolerance_is_within_it() {
        let scores = note_scores(&strokes(&[1.0]), &strokes(&[1.05]));
        assert_eq!(scores.onset_f1, 1.0);
        assert_eq!(note_scores(&strokes(&[1.0]), &strokes(&[1.0502])).onset_f1, 0.0);
    }

    #[test]
    fn velocities_are_correlated_over_the_notes_that_match() {
        let notes = |velocities: &[u8]| -> Vec<Note> {
            let at =
                |(index, velocity): (usize, &u8)| Note { velocity: *velocity, ..strokes(&[index as f64])[0] };
            velocities.iter().enumerate().map(at).collect()
        };
        let of = |due: &[u8], heard: &[u8]| note_scores(&notes(due), &notes(heard)).velocity_correlation;
        assert_eq!(of(&[20, 40, 60], &[50, 60, 70]), Some(1.0));
        assert_eq!(of(&[20, 40, 60], &[70, 60, 50]), Some(-1.0));
        // As numpy.corrcoef has it.
        let mixed = of(&[10, 20, 60], &[90, 30, 120]).unwrap();
        assert!((mixed - 0.618_589_6).abs() < 1e-6, "{mixed}");
        assert_eq!(of(&[64, 64, 64], &[50, 60, 70]), None);
        assert_eq!(of(&[20, 40], &[90, 90]), None);
        assert_eq!(of(&[20], &[90]), None);
        // A note that matches none does not count.
        let mut heard = notes(&[50, 60, 70]);
        heard.push(Note { start_secs: 7.0, velocity: 1, ..heard[0] });
        assert_eq!(note_scores(&notes(&[20, 40, 60]), &heard).velocity_correlation, Some(1.0));
    }

    #[test]
    fn nothing_scores_nothing() {
        let scores = note_scores(&[], &[]);
        assert_eq!((scores.onset_f1, scores.onset_error_median_secs, scores.matched), (0.0, None, 0));
    }
}
