//! Measured and simulated motion of a joint, in the two seconds in which it moves most.

use etude_stage::{JOINT_NAMES, RAIL};

use super::document::{Curve, Figure};
use super::number::{milli_unit, number};
use crate::assessment::Replayed;
use crate::motion::RecordedMotion;

/// Length of a figure, s.
const SECS: f64 = 2.0;
/// Readings are thinned to this interval to choose the stretch, s, so that noise does not count as
/// motion.
const BIN_SECS: f64 = 0.05;
/// Between two points of a simulated curve, s.
const STEP_SECS: f64 = 0.005;

/// A joint in the motion in which it moves most; `None` if it moves in none. Values in mrad or mm.
pub(super) fn overlay(joint: usize, replayed: &[Replayed<'_>]) -> Option<Figure> {
    let moving = replayed.iter().filter(|replayed| replayed.motion.moves[joint]);
    let (_, begin, replayed) = moving
        .map(|replayed| {
            let (path, begin) = busiest(replayed.motion, joint);
            (path, begin, replayed)
        })
        .reduce(|most, next| if next.0 > most.0 { next } else { most })?;
    let end = begin + SECS;
    let measured = replayed.motion.readings(joint).filter(|(secs, _)| (begin..=end).contains(secs));
    let simulated = |which: usize| {
        let points = (0..=(SECS / STEP_SECS) as usize).map(|point| begin + point as f64 * STEP_SECS);
        replayed.traces[which].as_ref().map_or_else(Vec::new, |trace| {
            points.map(|secs| [secs, 1e3 * trace.position(joint, secs)]).collect()
        })
    };
    let name = JOINT_NAMES[joint];
    let what = if joint == RAIL { "the rail" } else { name };
    Some(Figure {
        name: name.to_string(),
        caption: format!(
            "{what} in {}, {} s to {} s",
            replayed.motion.file_name(),
            number(begin),
            number(end)
        ),
        unit: milli_unit(joint),
        curves: [
            Curve { name: "measured", points: measured.map(|(secs, value)| [secs, 1e3 * value]).collect() },
            Curve { name: "before", points: simulated(0) },
            Curve { name: "after", points: simulated(1) },
        ],
    })
}

/// How far a joint moves in the stretch in which it moves farthest, and when that begins, s.
fn busiest(motion: &RecordedMotion, joint: usize) -> (f64, f64) {
    let mut thinned: Vec<(f64, f64)> = Vec::new();
    for (secs, value) in motion.readings(joint) {
        if thinned.last().is_none_or(|(last, _)| secs - last >= BIN_SECS) {
            thinned.push((secs, value));
        }
    }
    // Distance covered until each reading.
    let mut covered = vec![0.0];
    for pair in thinned.windows(2) {
        covered.push(covered[covered.len() - 1] + (pair[1].1 - pair[0].1).abs());
    }
    let mut most = (0.0, 0.0);
    for (index, (begin, _)) in thinned.iter().enumerate() {
        let end = thinned.partition_point(|(secs, _)| *secs <= begin + SECS).saturating_sub(1);
        // The end of the recording cuts later stretches short.
        let is_whole = index == 0 || begin + SECS <= motion.secs();
        let path = covered[end.max(index)] - covered[index];
        if is_whole && path > most.0 {
            most = (path, *begin);
        }
    }
    most
}
