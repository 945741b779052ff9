//! What slow presses of keys (excitation `keys`) show of the keyboard: from the encoders and the
//! duties of the motors, without a replay.
//!
//! A finger that rests on a key is where the key is. The motion is so slow that times do not
//! matter: 5 ms are a hundredth of a key's travel. So the joints say where the key begins to sound,
//! where it is silent again and where its bottom is; and the duties say how hard it pushes back,
//! once those of the same finger in the air are taken off. Backlash does not matter either: while
//! the key pushes, it is on the same side.
//!
//! Presses beside the gaps between keys show the lateral position of the keyboard ([`lateral`]),
//! pushes against black keys how far toward the player ([`depth`]).

use etude_stage::PhysicalParams;
use etude_stage::geometry::WHITE;
use etude_stage::hand::FINGERS;
use etude_stage::params::WorldRow;
use nalgebra::{Matrix2, Matrix3x2};

use crate::motion::RecordedMotion;
use crate::parameter_bounds::FIRST_BEND;

mod depth;
mod hand;
mod lateral;
mod press;
mod sample;

use hand::Hand;
use press::{Press, presses};
pub use sample::Measured;
use sample::{MIN_PRESSES, Sample, bias, common, mean, means_by_finger, world};

/// Errors that all presses share, half of a 95 % interval. A position, as a share of travel: an
/// event comes some milliseconds late, and a fingertip sinks in. A height, m. A force, as a share
/// of it: a fingertip rubs on the key, which also adds damping. [our estimate, from twins with
/// known keyboards]
const POSITION_ERROR: f64 = 0.012;
const HEIGHT_ERROR_M: f64 = 1e-4;
const FORCE_ERROR: f64 = 0.05;

/// Measures the keyboard by the slow presses among `motions`. `params` has the scale of torque of
/// the drives. Empty if there are too few presses.
pub fn measure(motions: &[RecordedMotion], params: &PhysicalParams) -> Vec<Measured> {
    let hands = |depth: f64| -> Vec<Hand<'_>> {
        let slow = motions.iter().filter(|motion| motion.presses_keys());
        slow.map(|motion| Hand { motion, params, side: motion.side(), depth }).collect()
    };
    // Where a key is pressed depends a little on the keyboard's depth.
    let nominal = hands(0.0);
    let Some(heights) = heights(&presses(&nominal)) else { return Vec::new() };
    let fronts = depth::fronts(&nominal, &heights.map(|of| of.value));
    let keyboard_depth = fronts.as_ref().map(common);
    let hands = hands(keyboard_depth.map_or(0.0, |depth| depth.value));
    let presses = presses(&hands);
    let Some(heights) = self::heights(&presses) else { return Vec::new() };
    let all = |value: &dyn Fn(&Press<'_>) -> f64| -> Vec<f64> { presses.iter().map(value).collect() };
    let threshold = |press: &Press<'_>| 1.0 - (press.bottom - press.sounds_at);
    let hysteresis = all(&|press| (press.sounds_at - press.silent_at) / threshold(press));
    let threshold = mean(&all(&threshold));
    let mut measured = vec![
        world(WorldRow::KeyThreshold, threshold.with(POSITION_ERROR)),
        world(WorldRow::KeyHysteresis, mean(&hysteresis).with(POSITION_ERROR / threshold.value)),
    ];
    let height = common(&heights);
    measured.push(world(WorldRow::KeyboardHeight, height.with(HEIGHT_ERROR_M)));
    measured.extend(
        keyboard_depth.map(|found| world(WorldRow::KeyboardDepth, found.with(depth::SHARED_ERROR_M))),
    );
    for finger in 0..FINGERS {
        let own = presses.iter().filter(|press| press.finger == finger);
        let jacobians: Vec<Matrix3x2<f64>> = own.map(|press| press.jacobian).collect();
        let jacobian = jacobians.iter().sum::<Matrix3x2<f64>>() / jacobians.len() as f64;
        let up = heights[finger].with(HEIGHT_ERROR_M).minus(height);
        let ahead = fronts
            .zip(keyboard_depth)
            .map(|(fronts, common)| fronts[finger].with(depth::SHARED_ERROR_M).minus(common));
        measured.extend(biases(finger, &jacobian, up, ahead));
    }
    let springs: Vec<[f64; 2]> = presses.iter().filter_map(Press::spring).collect();
    if springs.len() >= MIN_PRESSES * FINGERS {
        let [length, ..] = WHITE.size;
        let force: Vec<f64> = springs.iter().map(|[torque, _]| torque / length).collect();
        let stiffness: Vec<f64> = springs.iter().map(|[_, stiffness]| *stiffness).collect();
        for (quantity, values) in [(WorldRow::KeyPreload, force), (WorldRow::KeyStiffness, stiffness)] {
            let sample = mean(&values);
            measured.push(world(quantity, sample.with(FORCE_ERROR * sample.value.abs())));
        }
    }
    measured.extend(lateral::measure(&hands));
    measured
}

/// How high each finger finds the keyboard, m, by its encoders; none if one has pressed too few
/// keys.
fn heights(presses: &[Press<'_>]) -> Option<[Sample; FINGERS]> {
    means_by_finger(|finger| {
        let own = presses.iter().filter(|press| press.finger == finger);
        own.map(|press| (1.0 - press.bottom) * press.travel_m).collect()
    })
}

/// Encoder biases of a finger's joints that bend first and second, from how much farther `up` and
/// `ahead` than the others it finds the keyboard, m; without the latter, that of the first alone.
/// `jacobian` is how far the fingertip moves with the joints, m/rad.
fn biases(finger: usize, jacobian: &Matrix3x2<f64>, up: Sample, ahead: Option<Sample>) -> Vec<Measured> {
    let bias = |bend: usize, value: f64, half: f64| bias(finger, FIRST_BEND + bend, Sample { value, half });
    let both = Matrix2::from_fn(|axis, bend| jacobian[(bend, axis)]);
    let Some((ahead, inverse)) = ahead.zip(both.try_inverse()) else {
        let slope = jacobian[(0, 1)];
        return vec![bias(0, up.value / slope, up.half / slope.abs())];
    };
    let of = |bend: usize| {
        let [of_ahead, of_up] = [inverse[(bend, 0)], inverse[(bend, 1)]];
        let value = of_ahead * ahead.value + of_up * up.value;
        bias(bend, value, (of_ahead * ahead.half).hypot(of_up * up.half))
    };
    vec![of(0), of(1)]
}

/// What slow presses showed, in a sentence; none if no motion presses keys slowly.
pub fn describe(motions: &[RecordedMotion], measured: &[Measured]) -> Option<String> {
    motions.iter().any(RecordedMotion::presses_keys).then(|| {
        let value = |quantity: WorldRow| {
            let one = measured.iter().find(|one| one.path == quantity.row().name)?;
            Some(one.value)
        };
        let found = value(WorldRow::KeyThreshold)
            .zip(value(WorldRow::KeyHysteresis))
            .zip(value(WorldRow::KeyboardHeight));
        let Some(((threshold, hysteresis), height)) = found else {
            return format!(
                "slow presses show nothing: each finger must press {MIN_PRESSES} keys to their bottom; check that the keyboard is in its position, \
                 and record the excitation `keys` again"
            );
        };
        let silent = threshold * (1.0 - hysteresis);
        let force = value(WorldRow::KeyPreload)
            .map_or_else(String::new, |force| format!(", and {force:.2} N move it from rest"));
        let position = |quantity: WorldRow, direction: &str, unknown: &str| {
            value(quantity).map_or_else(
                || format!("; how far {direction} was not measured, since {unknown}: an earlier value stays"),
                |found| format!(", {:+.1} mm {direction}", 1e3 * found),
            )
        };
        let lateral = position(
            WorldRow::KeyboardLateral,
            "toward the high notes",
            "a finger has not made both keys beside a gap sound",
        );
        let depth = position(WorldRow::KeyboardDepth, "toward the player", "a finger has met too few black keys");
        format!(
            "a key sounds at {threshold:.2} of its travel and is silent again at {silent:.2}{force}; the keyboard is {:+.1} mm high{lateral}{depth}",
            1e3 * height
        )
    })
}

/// Sets what was measured.
pub fn apply(measured: &[Measured], params: &mut PhysicalParams) {
    for Measured { path, value, .. } in measured {
        // The path is one of the rows and the value within its range.
        let _ = params.set(path, *value);
    }
}
