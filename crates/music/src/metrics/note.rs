//! Scores by note: played notes matched with the notes of the song, and their onset errors.
//!
//! The measure is that of music transcription, as the `mir_eval` package computes it. Played notes
//! are matched to the song's, one to one and as many as possible, if the pitch is the same and the
//! onset is near; in the stricter variant the release must be near too. Each pitch is matched
//! separately.

use serde::{Deserialize, Serialize};

use super::matching::{ONSET_SECS, matched_with_offset, pairs_within};
use super::share;
use crate::note::Note;

/// A note that comes later or earlier than this is not the same note, s (our choice; the time
/// between two eighths at 120 a minute).
const MAX_LAG_SECS: f64 = 0.25;

/// Share of the range of the song's velocities by which a velocity may differ; the default of
/// `mir_eval.transcription_velocity`.
const VELOCITY_TOLERANCE: f64 = 0.1;

/// Scores of a performance by note. Precision, recall and F1 are from 0 to 1, and 0 where the song
/// or the performance has no notes, as in `mir_eval`.
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
    /// Median of played minus due onset over the notes matched by onset, in seconds; late is
    /// positive. None without a match.
    pub onset_error_median_secs: Option<f64>,
    /// Size of these errors, whether early or late, that 95 % of them do not exceed, in seconds.
    pub onset_error_p95_secs: Option<f64>,
    /// Median of played minus due onset over notes of the same pitch that are matched within 250
    /// ms, in seconds: how late the whole performance is. None without a match.
    pub lag_secs: Option<f64>,
    /// `onset_f1` if everything were played earlier by `lag_secs`.
    pub onset_f1_without_lag: f64,
    /// Correlation (Pearson's) of played and due MIDI velocities over the notes matched by onset.
    /// None where either is the same for all of them.
    pub velocity_correlation: Option<f64>,
    /// As `onset_f1`, with the velocity near as well, after the played velocities were scaled and
    /// shifted to fit the song's best.
    pub onset_velocity_f1: f64,
    /// Notes matched by pitch and onset.
    pub matched: usize,
    /// Notes of the song that were not.
    pub missed: usize,
    /// Played notes that match none.
    pub wrong: usize,
}

/// Scores played notes against those of the song. The time grows with the square of the number of
/// strokes of one pitch that follow each other within the tolerance.
pub fn note_scores(reference: &[Note], played: &[Note]) -> NoteScores {
    let mut pairs = matched_notes(reference, played);
    // Sums are then the same in whatever order the notes are given.
    pairs.sort_by(|[a, _], [b, _]| {
        let (a, b) = (&reference[*a], &reference[*b]);
        a.start_secs.total_cmp(&b.start_secs).then(a.pitch.cmp(&b.pitch))
    });
    let with_offset = matched_with_offset(reference, played);
    let lag_secs = lag_secs(reference, played);
    let matched = pairs.len();
    let mut errors: Vec<f64> =
        pairs.iter().map(|[due, heard]| played[*heard].start_secs - reference[*due].start_secs).collect();
    errors.sort_by(f64::total_cmp);
    let mut sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let of = |sorted: &[f64], q| (matched > 0).then(|| quantile(sorted, q));
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
        onset_error_p95_secs: of(&sizes, 0.95),
        lag_secs,
        onset_f1_without_lag: onset_f1_without(lag_secs.unwrap_or(0.0), reference, played),
        onset_velocity_f1: rates(
            matched_with_velocity(&pairs, reference, played),
            reference.len(),
            played.len(),
        )[2],
        velocity_correlation: velocity_correlation(&pairs, reference, played),
        matched,
        missed: reference.len() - matched,
        wrong: played.len() - matched,
    }
}

/// Pairs of a note of the song and the played note that matches it by pitch and onset, as indices
/// into the two lists, in the order of the song's.
///
/// Of all largest matchings, it is the one with the smallest sum of onset errors.
pub fn matched_notes(reference: &[Note], played: &[Note]) -> Vec<[usize; 2]> {
    pairs_within(ONSET_SECS, reference, played)
}

fn lag_secs(reference: &[Note], played: &[Note]) -> Option<f64> {
    let pairs = pairs_within(MAX_LAG_SECS, reference, played);
    let lags = pairs.iter().map(|[due, heard]| played[*heard].start_secs - reference[*due].start_secs);
    let mut lags: Vec<f64> = lags.collect();
    lags.sort_by(f64::total_cmp);
    (!lags.is_empty()).then(|| quantile(&lags, 0.5))
}

fn onset_f1_without(lag_secs: f64, reference: &[Note], played: &[Note]) -> f64 {
    let earlier: Vec<Note> = played
        .iter()
        .map(|note| Note {
            start_secs: note.start_secs - lag_secs,
            end_secs: note.end_secs - lag_secs,
            ..*note
        })
        .collect();
    rates(matched_notes(reference, &earlier).len(), reference.len(), played.len())[2]
}

fn rates(matched: usize, reference: usize, played: usize) -> [f64; 3] {
    let (precision, recall) = (share(matched, played, 0.0), share(matched, reference, 0.0));
    [precision, recall, share(2 * matched, reference + played, 0.0)]
}

/// Velocities of the matched notes, the song's and the played ones, without their means.
fn velocities(pairs: &[[usize; 2]], reference: &[Note], played: &[Note]) -> [Vec<f64>; 2] {
    [(0, reference), (1, played)].map(|(side, notes)| {
        let values: Vec<f64> = pairs.iter().map(|pair| f64::from(notes[pair[side]].velocity)).collect();
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        values.iter().map(|value| value - mean).collect()
    })
}

fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Velocities are whole numbers, so that any difference is far above rounding.
const SAME_VELOCITIES: f64 = 1e-6;

fn velocity_correlation(pairs: &[[usize; 2]], reference: &[Note], played: &[Note]) -> Option<f64> {
    let [due, heard] = velocities(pairs, reference, played);
    let spread = (product(&due, &due) * product(&heard, &heard)).sqrt();
    (spread > SAME_VELOCITIES).then(|| product(&due, &heard) / spread)
}

/// How many of the matched notes also have the velocity that is due, by the rule of
/// `mir_eval.transcription_velocity`: the line through the matched velocities with the least
/// squares takes out how loud the instrument is.
fn matched_with_velocity(pairs: &[[usize; 2]], reference: &[Note], played: &[Note]) -> usize {
    let ends = reference
        .iter()
        .fold((u8::MAX, u8::MIN), |(low, high), note| (low.min(note.velocity), high.max(note.velocity)));
    let range = f64::from(ends.1.saturating_sub(ends.0).max(1));
    let [due, heard] = velocities(pairs, reference, played);
    let spread = product(&heard, &heard);
    let slope = if spread > SAME_VELOCITIES { product(&due, &heard) / spread } else { 0.0 };
    due.iter()
        .zip(&heard)
        .filter(|(due, heard)| (slope * *heard - *due).abs() / range < VELOCITY_TOLERANCE)
        .count()
}

/// Linear interpolation between order statistics, as numpy's default; the list is sorted and not
/// empty.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let position = q * (sorted.len() - 1) as f64;
    let (below, above) = (position.floor() as usize, position.ceil() as usize);
    sorted[below] + (sorted[above] - sorted[below]) * (position - position.floor())
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
        assert!((scores.onset_error_median_secs.unwrap() + 0.035).abs() < 1e-12);
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
    fn a_lag_is_no_mistake_of_the_player() {
        let due = strokes(&[0.5, 1.0, 1.5, 2.0]);
        let scores = note_scores(&due, &strokes(&[0.57, 1.08, 1.59, 2.2]));
        assert_eq!((scores.matched, scores.onset_f1_without_lag), (0, 0.75));
        assert!((scores.lag_secs.unwrap() - 0.085).abs() < 1e-12);
        let early = note_scores(&due, &strokes(&[0.4, 0.9, 1.4, 1.9]));
        assert!((early.lag_secs.unwrap() + 0.1).abs() < 1e-12 && early.onset_f1_without_lag == 1.0);
        // A note later is another note.
        assert_eq!(note_scores(&due[..1], &strokes(&[0.8])).lag_secs, None);
    }

    #[test]
    fn nothing_scores_nothing() {
        let scores = note_scores(&[], &[]);
        assert_eq!((scores.onset_f1, scores.onset_error_median_secs, scores.matched), (0.0, None, 0));
    }
}
