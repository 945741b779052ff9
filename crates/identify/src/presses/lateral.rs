//! How far to the side the keyboard is: by which of two neighbouring keys sounds when a finger
//! presses beside the gap between them. Where the lower one gives way to the higher one is the gap.

use etude_music::{CONTROL_HZ, KEY_COUNT, key_is_black};
use etude_stage::geometry::{WHITE, WHITE_PITCH, key_lateral};
use etude_stage::hand::{FINGERS, TIP_RADIUS};
use etude_stage::params::WorldRow;

use super::hand::{Hand, OFF_MIDDLE_M};
use super::sample::{Measured, Sample, bias, common, world};

/// A target that is this far below the top of a white key presses it, m.
const PRESSES_M: f64 = 0.008;
/// A target this far above it does not touch it yet, m.
const CLEAR_M: f64 = 0.004;
/// Error of what a finger's presses have in common, half of a 95 % interval, m. [our estimate, from
/// twins with known keyboards]
const SHARED_ERROR_M: f64 = 3e-4;

/// A press beside a gap.
struct GapPress {
    finger: usize,
    /// How far from the gap's nominal position the fingertip was before it came down, m, by its
    /// encoders.
    offset_m: f64,
    /// Keys that sounded: -1 the lower one alone, 1 the higher one alone, 0 both, or none.
    sounded: f64,
    /// How far the fingertip moves to the side with the finger's first joint, m/rad.
    slope: f64,
}

/// Measures the keyboard's lateral position, and the encoder bias of each finger's first joint.
/// Empty if a finger has found no gap.
pub(super) fn measure(hands: &[Hand<'_>]) -> Vec<Measured> {
    let presses: Vec<GapPress> = hands.iter().flat_map(gap_presses).collect();
    let gap_of = |finger: usize| {
        let own = presses.iter().filter(|press| press.finger == finger);
        gap(own.map(|press| [press.offset_m, press.sounded]).collect())
    };
    let Some(gaps) = (0..FINGERS).map(gap_of).collect::<Option<Vec<Sample>>>() else { return Vec::new() };
    let gaps: [Sample; FINGERS] = std::array::from_fn(|finger| gaps[finger].with(SHARED_ERROR_M));
    let lateral = common(&gaps);
    let mut measured = vec![world(WorldRow::KeyboardLateral, lateral)];
    for (finger, gap) in gaps.into_iter().enumerate() {
        let slopes: Vec<f64> =
            presses.iter().filter(|press| press.finger == finger).map(|press| press.slope).collect();
        let (offset, slope) = (gap.minus(lateral), slopes.iter().sum::<f64>() / slopes.len() as f64);
        measured.push(bias(
            finger,
            0,
            Sample { value: offset.value / slope, half: offset.half / slope.abs() },
        ));
    }
    measured
}

/// Where the lower key gives way to the higher one, of presses at a position with what sounded: the
/// mean of that position if it is as likely anywhere between two presses (Spearman and Kärber's
/// estimate). It lies above the presses below which only the lower key sounded, and below those
/// above which only the higher one did. None if only one of the two ever sounded alone.
fn gap(mut points: Vec<[f64; 2]>) -> Option<Sample> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let lower = points.iter().position(|[_, sounded]| *sounded < 0.0)?;
    let higher = points.iter().rposition(|[_, sounded]| *sounded > 0.0)?;
    // Beyond them, a finger that has not gone deep enough.
    let points = points.get(lower..=higher)?;
    let outside = |[_, sounded]: &&[f64; 2], side: f64| *sounded == side;
    let low = points.iter().take_while(|point| outside(point, -1.0)).last()?[0];
    let high = points.iter().rev().take_while(|point| outside(point, 1.0)).last()?[0];
    let steps =
        points.windows(2).map(|pair| (pair[1][1] - pair[0][1]) / 2.0 * pair[0][0].midpoint(pair[1][0]));
    Some(Sample { value: steps.sum(), half: (high - low) / 2.0 })
}

/// The presses of a recording beside gaps.
fn gap_presses(hand: &Hand<'_>) -> Vec<GapPress> {
    let mut found = Vec::new();
    for finger in 0..FINGERS {
        let tip = |step: usize| hand.target(finger, step);
        let above = |step: usize| tip(step).map(|tip| tip[2] - TIP_RADIUS - WHITE.top());
        let is_down = |step: usize| above(step).is_some_and(|above| above < -PRESSES_M);
        let mut clear = None;
        for step in 0..hand.motion.commands.steps() {
            if above(step).is_some_and(|above| above > CLEAR_M) {
                clear = Some(step);
            }
            // The last step of a press.
            if is_down(step) && !is_down(step + 1) {
                found.extend(clear.and_then(|clear| gap_press(hand, finger, [clear, step])));
            }
        }
    }
    found
}

/// The press between two steps, the last one above the keys and the last one that presses.
fn gap_press(hand: &Hand<'_>, finger: usize, [clear, last]: [usize; 2]) -> Option<GapPress> {
    let y = hand.target(finger, last)?[1];
    let whites = (0..KEY_COUNT).filter(|key| !key_is_black(*key));
    // The white key whose upper gap is nearest.
    let from_gap = |key: usize| y - key_lateral(key) - WHITE_PITCH / 2.0;
    let lower = whites.clone().min_by(|a, b| from_gap(*a).abs().total_cmp(&from_gap(*b).abs()))?;
    let higher = whites.clone().find(|key| *key > lower)?;
    if from_gap(lower).abs() > WHITE_PITCH / 2.0 - OFF_MIDDLE_M {
        return None;
    }
    let sounds = |key: usize| {
        let mut events = hand.motion.keys.iter().filter(|event| event.key == key);
        events.rfind(|event| event.secs <= last as f64 / CONTROL_HZ).is_some_and(|event| event.velocity > 0)
    };
    let sounded = match [lower, higher].map(sounds) {
        [true, false] => -1.0,
        [false, true] => 1.0,
        [true, true] | [false, false] => 0.0,
    };
    let index = hand.indices([clear as f64 / CONTROL_HZ, f64::INFINITY]).start;
    let gap = key_lateral(lower) + WHITE_PITCH / 2.0;
    let slope = hand.moved_by(finger, &hand.angles(finger, index), 0)[1];
    Some(GapPress { finger, offset_m: hand.lateral(finger, index)? - gap, sounded, slope })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_where_one_key_gives_way_to_the_next() {
        let points = |sounded: &[f64]| -> Vec<[f64; 2]> {
            sounded.iter().enumerate().rev().map(|(index, sounded)| [index as f64, *sounded]).collect()
        };
        let found = |sounded: &[f64]| gap(points(sounded)).map(|found| (found.value, found.half));
        assert_eq!(found(&[-1.0, -1.0, 1.0, 1.0, 1.0]), Some((1.5, 0.5)));
        assert_eq!(found(&[-1.0, 0.0, 0.0, 0.0, 1.0]), Some((2.0, 2.0)), "both keys, or none");
        assert_eq!(found(&[-1.0, 1.0, -1.0, -1.0, 1.0, 1.0]), Some((2.5, 2.0)), "a press that slipped");
        assert_eq!(found(&[0.0, -1.0, 1.0, 1.0, 0.0]), Some((1.5, 0.5)), "not deep enough");
        for one_side in [[-1.0; 3], [1.0; 3], [0.0; 3], [1.0, 0.0, -1.0]] {
            assert_eq!(found(&one_side), None);
        }
        assert_eq!(found(&[]), None);
    }
}
