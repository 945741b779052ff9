//! Rhythms: the lengths of notes and rests in a bar.

use super::draw::Draw;

/// Lengths of notes, beats.
const LENGTHS: [f64; 8] = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0];
/// Least time from one onset to the next, s: four control steps.
pub(super) const LEAST_SECS: f64 = 0.2;
/// Spread of the logarithm of a note's length around that of the piece's pace.
const SPREAD: f64 = 0.55;
/// Lengths that end off the beat are drawn up to this, beats.
const LONGEST_OFF_BEAT: f64 = 0.5;
const TINY: f64 = 1e-9;

/// A note or a rest of a bar.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub beats: f64,
    pub is_rest: bool,
}

/// A bar of `beats` beats of `beat_secs` seconds, whose notes last about `pace_secs`; each cell but the first is a rest with the
/// probability `rests`.
pub(super) fn bar(draw: &mut Draw, beats: f64, beat_secs: f64, pace_secs: f64, rests: f64) -> Vec<Cell> {
    let mut cells = Vec::new();
    let mut gone = 0.0;
    while beats - gone > TINY {
        let weights = LENGTHS.map(|length| {
            let secs = length * beat_secs;
            let end = gone + length;
            let on_beat = (end - end.round()).abs() < TINY;
            let fits = end <= beats + TINY && secs >= LEAST_SECS - TINY;
            let left = beats - end;
            let completes = left < TINY || left * beat_secs >= LEAST_SECS - TINY;
            if fits && completes && (on_beat || length <= LONGEST_OFF_BEAT) {
                (-((secs / pace_secs).ln() / SPREAD).powi(2) / 2.0).exp() + 1e-6
            } else {
                0.0
            }
        });
        // What is left of the bar where no length fits.
        let length = draw.weighted(&weights).map_or(beats - gone, |index| LENGTHS[index]);
        let is_rest = !cells.is_empty() && draw.chance(rests);
        cells.push(Cell { beats: length, is_rest });
        gone += length;
    }
    cells
}
