//! Rhythms: the lengths of notes and rests in a bar.

use super::draw::Draw;

/// Lengths of notes, beats.
const LENGTHS: [f64; 8] = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0];
/// Shortest time from one onset to the next, s: four control steps.
pub(super) const MIN_ONSET_SECS: f64 = 0.2;
/// Spread of the logarithm of a note's length around that of the melody's typical interval.
const SPREAD: f64 = 0.55;
/// Lengths that end off the beat are drawn up to this, beats.
const MAX_OFF_BEAT: f64 = 0.5;
const BEAT_TOLERANCE: f64 = 1e-9;

/// A note or a rest of a bar.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub beats: f64,
    pub is_rest: bool,
}

/// A bar of `beats` beats of `beat_secs` seconds, whose notes last about `onset_interval_secs`;
/// each cell but the first is a rest with the probability `rests`.
pub(super) fn bar(
    draw: &mut Draw,
    beats: f64,
    beat_secs: f64,
    onset_interval_secs: f64,
    rests: f64,
) -> Vec<Cell> {
    let mut cells = Vec::new();
    let mut elapsed = 0.0;
    while beats - elapsed > BEAT_TOLERANCE {
        let weights = LENGTHS.map(|length| {
            let secs = length * beat_secs;
            let end = elapsed + length;
            let on_beat = (end - end.round()).abs() < BEAT_TOLERANCE;
            let fits = end <= beats + BEAT_TOLERANCE && secs >= MIN_ONSET_SECS - BEAT_TOLERANCE;
            let left = beats - end;
            let completes = left < BEAT_TOLERANCE || left * beat_secs >= MIN_ONSET_SECS - BEAT_TOLERANCE;
            if fits && completes && (on_beat || length <= MAX_OFF_BEAT) {
                (-((secs / onset_interval_secs).ln() / SPREAD).powi(2) / 2.0).exp() + 1e-6
            } else {
                0.0
            }
        });
        // What is left of the bar where no length fits.
        let length = draw.weighted(&weights).map_or(beats - elapsed, |index| LENGTHS[index]);
        let is_rest = !cells.is_empty() && draw.chance(rests);
        cells.push(Cell { beats: length, is_rest });
        elapsed += length;
    }
    cells
}
