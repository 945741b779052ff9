//! Measured, before and after: one drawing a joint, of the two seconds in which it moves most.

use etude_stage::{JOINT_NAMES, RAIL};

use super::chart::Frame;
use super::document::Picture;
use super::html::escape;
use super::number::{milli_unit, number};
use super::sections::file_name;
use crate::motion::Motion;
use crate::replay::Trace;

/// How long a drawing is, s.
const SECS: f64 = 2.0;
/// Readings are thinned to one in so long for the choice of a stretch: noise is no motion.
const BIN_SECS: f64 = 0.05;
/// Between two points of a simulated curve, s.
const STEP_SECS: f64 = 0.005;
/// The drawing, in its own units.
const SIZE: [f64; 2] = [480.0, 290.0];
/// Before the fit a joint may be anywhere; of where it is drawn, this share of the motion's extent beyond it.
const BEYOND: f64 = 0.4;

/// Room above and below a curve, as a share of its extent.
const EDGE: f64 = 0.04;

/// A motion with its replays before and after the fit, unless a world diverged.
pub(super) struct Replayed<'a> {
    pub motion: &'a Motion,
    pub traces: [Option<Trace>; 2],
}

/// Draws a joint in the motion in which it moves most. `None` where it moves in none.
pub(super) fn overlay(joint: usize, replayed: &[&Replayed<'_>]) -> Option<Picture> {
    let moving = replayed.iter().filter(|replayed| replayed.motion.moves.get(joint) == Some(&true));
    let (_, begin, replayed) = moving
        .map(|replayed| {
            let (path, begin) = busiest(replayed.motion, joint);
            (path, begin, replayed)
        })
        .reduce(|most, next| if next.0 > most.0 { next } else { most })?;
    let time = [begin, begin + SECS];
    let readings: Vec<(f64, f64)> = (replayed.motion.readings(joint))
        .filter(|(secs, _)| (time[0]..=time[1]).contains(secs))
        .map(|(secs, value)| (secs, 1e3 * value))
        .collect();
    let simulated = |which: usize| {
        let trace = replayed.traces[which].as_ref();
        let points = (SECS / STEP_SECS) as usize;
        let at = move |point: usize| begin + point as f64 * STEP_SECS;
        trace.into_iter().flat_map(move |trace| {
            (0..=points).map(move |point| (at(point), 1e3 * trace.position(joint, at(point))))
        })
    };
    let inner = extent(readings.iter().copied().chain(simulated(1)));
    let margin = BEYOND * (inner[1] - inner[0]);
    let outer = extent(readings.iter().copied().chain(simulated(1)).chain(simulated(0)));
    let value = [outer[0].max(inner[0] - margin), outer[1].min(inner[1] + margin)];

    let unit = milli_unit(joint);
    let name = JOINT_NAMES[joint];
    let [width, height] = SIZE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
         aria-label=\"{name}: measured, before and after the fit\">"
    );
    let upper = Frame { x: [50.0, width - 8.0], y: [180.0, 32.0], time, value };
    upper.axes(unit, false, &mut svg);
    upper.curve("measured", readings.iter().copied(), &mut svg);
    upper.curve("before", simulated(0), &mut svg);
    upper.curve("after", simulated(1), &mut svg);
    legend(&replayed.traces, &mut svg);
    if let Some(after) = &replayed.traces[1] {
        let errors: Vec<(f64, f64)> = readings
            .iter()
            .map(|(secs, value)| (*secs, 1e3 * after.position(joint, *secs) - value))
            .collect();
        let noise = 2e3 * replayed.motion.noise[joint];
        let value = extent(errors.iter().copied().chain([(0.0, noise), (0.0, -noise)]));
        let lower = Frame { x: upper.x, y: [270.0, 210.0], time, value };
        lower.band(-noise, noise, &mut svg);
        lower.axes(
            &format!("{unit}: after − measured, and two standard deviations of the noise"),
            true,
            &mut svg,
        );
        lower.curve("after", errors.into_iter(), &mut svg);
    }
    svg.push_str("</svg>");
    let what = if joint == RAIL { "the rail" } else { name };
    let caption = format!(
        "{what} in {}, {} s to {} s",
        file_name(&replayed.motion.path),
        number(time[0]),
        number(time[1])
    );
    Some(Picture { svg, caption })
}

fn legend(traces: &[Option<Trace>; 2], svg: &mut String) {
    let of = |name: &str, trace: &Option<Trace>| match trace {
        Some(_) => name.to_string(),
        None => format!("{name} (diverged)"),
    };
    let [before, after] = [of("before", &traces[0]), of("after", &traces[1])];
    for (place, class, words) in
        [(0.0, "measured", "measured"), (1.0, "before", &before), (2.0, "after", &after)]
    {
        let x = 95.0 + 130.0 * place;
        svg.push_str(&format!(
            "<path class=\"{class}\" d=\"M{x} 14h30\"/><text x=\"{}\" y=\"18\">{}</text>",
            x + 36.0,
            escape(words)
        ));
    }
}

/// Smallest and largest value with some room; something around zero where there is none.
fn extent(points: impl Iterator<Item = (f64, f64)>) -> [f64; 2] {
    let values = points.map(|(_, value)| value).filter(|value| value.is_finite());
    let [low, high] =
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    let edge = EDGE * (high - low);
    if low < high { [low - edge, high + edge] } else { [-1.0, 1.0] }
}

/// How far a joint goes in the stretch in which it goes farthest, and when that begins, s.
fn busiest(motion: &Motion, joint: usize) -> (f64, f64) {
    let mut thinned: Vec<(f64, f64)> = Vec::new();
    for (secs, value) in motion.readings(joint) {
        if thinned.last().is_none_or(|(last, _)| secs - last >= BIN_SECS) {
            thinned.push((secs, value));
        }
    }
    // How far it has gone until each reading.
    let mut gone = vec![0.0];
    for pair in thinned.windows(2) {
        gone.push(gone[gone.len() - 1] + (pair[1].1 - pair[0].1).abs());
    }
    let mut most = (0.0, 0.0);
    for (index, (begin, _)) in thinned.iter().enumerate() {
        let end = thinned.partition_point(|(secs, _)| *secs <= begin + SECS).saturating_sub(1);
        // A stretch that the recording cuts short shows less.
        let is_whole = index == 0 || begin + SECS <= motion.secs();
        let path = gone[end.max(index)] - gone[index];
        if is_whole && path > most.0 {
            most = (path, *begin);
        }
    }
    most
}
