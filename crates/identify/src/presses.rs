//! What slow presses of keys (excitation `keys`) show of the keyboard: from the encoders and the duties of the motors, without a replay.
//!
//! A finger that rests on a key is where the key is. The motion is so slow that times do not matter: 5 ms are a hundredth of a key's
//! travel. So the joints say where the key begins to sound, where it is silent again and where its bottom is; and the duties say how
//! hard it pushes back, once those of the same finger in the air are taken off. Play in the gears does not matter either: while the key
//! pushes, it lies at the same side.
//!
//! Presses beside the gaps between keys show how far to the side the keyboard is ([`aside`]), pushes against black keys how far toward the
//! player ([`front`]).

use etude_music::key_is_black;
use etude_robot::allegro::{self, holding_torques};
use etude_stage::geometry::{KeyShape, WHITE_PITCH, key_lateral};
use etude_stage::hand::{FINGERS, JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::params::{JointRow, WorldRow};
use etude_stage::{JOINT_NAMES, PhysicalParams, RAIL, Side, kinematics};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3x2, Vector3};
use serde::{Deserialize, Serialize};

use crate::motion::{Commands, Motion};
use crate::rows::FIRST_BEND;

mod aside;
mod front;

/// Smallest number of presses of each finger that is enough.
const FEWEST: usize = 2;
/// A finger that passes a contact faster has slipped, travels a second.
const FASTEST: f64 = 5.0;
/// A key is at its bottom if it stays within this share of its travel of the deepest place, for at least this time, s.
const BOTTOM: (f64, f64) = (0.04, 0.25);
/// Time before a key sounds, and after it is silent, in which its finger comes and goes, s.
const AROUND_SECS: f64 = 1.2;
/// Readings to each side from which a speed is taken.
const SIDE: usize = 8;
/// A joint that is slower may be held by its friction, travels a second.
const MOVING: f64 = 0.5;
/// Shares of travel in which a finger is clear of the key, and in which it presses it.
const CLEAR: [f64; 2] = [-0.5, -0.12];
const PRESSES: [f64; 2] = [0.15, 0.9];
/// Unknowns of the force on a press: its zero, the finger's friction, what the key adds to that, the force at rest, and the spring.
const UNKNOWNS: usize = 5;
/// Errors that all presses share, half of a 95 % interval. A place, as a share of travel: an event comes some milliseconds late, and a
/// fingertip sinks in. A height, m. A force, as a share of it: a fingertip rubs on the key, which also adds damping. [our judgement, from
/// twins with known keyboards]
const PLACE_ERROR: f64 = 0.012;
const HEIGHT_ERROR_M: f64 = 1e-4;
const FORCE_ERROR: f64 = 0.05;
/// Step of the differences for a Jacobian, rad.
const STEP_RAD: f64 = 1e-6;

/// A parameter that was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Its path as in `etude_stage::PhysicalParams::rows`.
    pub path: String,
    /// Its value, in its SI unit.
    pub value: f64,
    /// The 95 % interval of the mean over the keys that were pressed.
    pub interval: [f64; 2],
}

/// A press: shares of the simulated key's travel, of a keyboard at its nominal height.
struct Press<'a> {
    hand: &'a Hand<'a>,
    key: usize,
    finger: usize,
    /// When the key begins to sound, and when it is silent again, s.
    secs: [f64; 2],
    /// Where the key sounds, where it is silent again, and its bottom.
    places: [f64; 3],
    /// Travel under the fingertip, m.
    travel_m: f64,
    /// How far along `x` and `z` the tip moves with the joints that bend, m/rad.
    turns: Matrix3x2<f64>,
}

impl Press<'_> {
    /// Torque at the hinge of the key at rest, N·m, and its growth, N·m/rad.
    fn spring(&self) -> Option<[f64; 2]> {
        let [sounds, silent] = self.secs;
        let around = [sounds - AROUND_SECS, silent + AROUND_SECS];
        self.hand.spring(self.key, self.finger, around, self.places[2] - 1.0)
    }
}

/// Measures the keyboard by the slow presses among `motions`. `params` has the scale of torque of the drives. Empty if there are too few
/// presses.
pub fn measure(motions: &[Motion], params: &PhysicalParams) -> Vec<Measured> {
    let hands = |depth: f64| -> Vec<Hand<'_>> {
        let slow = motions.iter().filter(|motion| motion.presses_keys());
        slow.map(|motion| Hand { motion, params, side: motion.side(), depth }).collect()
    };
    // Where a key is pressed depends a little on the keyboard's depth.
    let nominal = hands(0.0);
    let Some(heights) = heights(&presses(&nominal)) else { return Vec::new() };
    let fronts = front::fronts(&nominal, &heights.map(|of| of.value));
    let depth = fronts.as_ref().map(common);
    let hands = hands(depth.map_or(0.0, |depth| depth.value));
    let presses = presses(&hands);
    let Some(heights) = self::heights(&presses) else { return Vec::new() };
    let all = |value: &dyn Fn(&Press<'_>) -> f64| -> Vec<f64> { presses.iter().map(value).collect() };
    let threshold = |press: &Press<'_>| 1.0 - (press.places[2] - press.places[0]);
    let hysteresis = all(&|press| (press.places[0] - press.places[1]) / threshold(press));
    let threshold = mean(&all(&threshold));
    let mut measured = vec![
        world(WorldRow::KeyThreshold, threshold.with(PLACE_ERROR)),
        world(WorldRow::KeyHysteresis, mean(&hysteresis).with(PLACE_ERROR / threshold.value)),
    ];
    let height = common(&heights);
    measured.push(world(WorldRow::KeyboardHeight, height.with(HEIGHT_ERROR_M)));
    measured.extend(depth.map(|depth| world(WorldRow::KeyboardDepth, depth.with(front::SHARED_M))));
    for finger in 0..FINGERS {
        let own = presses.iter().filter(|press| press.finger == finger);
        let turns: Vec<Matrix3x2<f64>> = own.map(|press| press.turns).collect();
        let turns = turns.iter().sum::<Matrix3x2<f64>>() / turns.len() as f64;
        let up = heights[finger].with(HEIGHT_ERROR_M).minus(height);
        let ahead =
            fronts.zip(depth).map(|(fronts, depth)| fronts[finger].with(front::SHARED_M).minus(depth));
        measured.extend(biases(finger, &turns, up, ahead));
    }
    let springs: Vec<[f64; 2]> = presses.iter().filter_map(Press::spring).collect();
    if springs.len() >= FEWEST * FINGERS {
        let [length, ..] = etude_stage::geometry::WHITE.size;
        let force: Vec<f64> = springs.iter().map(|[torque, _]| torque / length).collect();
        let stiffness: Vec<f64> = springs.iter().map(|[_, stiffness]| *stiffness).collect();
        for (quantity, values) in [(WorldRow::KeyPreload, force), (WorldRow::KeyStiffness, stiffness)] {
            let sample = mean(&values);
            measured.push(world(quantity, sample.with(FORCE_ERROR * sample.value.abs())));
        }
    }
    measured.extend(aside::measure(&hands));
    measured
}

fn presses<'a>(hands: &'a [Hand<'a>]) -> Vec<Press<'a>> {
    hands.iter().flat_map(Hand::presses).collect()
}

/// How high each finger finds the keyboard, m, by its encoders; none if one has pressed too few keys.
fn heights(presses: &[Press<'_>]) -> Option<[Sample; FINGERS]> {
    let of = |finger: usize| -> Vec<f64> {
        let own = presses.iter().filter(|press| press.finger == finger);
        own.map(|press| (1.0 - press.places[2]) * press.travel_m).collect()
    };
    let heights: [Vec<f64>; FINGERS] = std::array::from_fn(of);
    heights.iter().all(|of| of.len() >= FEWEST).then(|| heights.map(|of| mean(&of)))
}

/// What the fingers have in common of where they find the keyboard: its place. A keyboard that is elsewhere and encoders that read too far
/// look the same.
fn common(places: &[Sample; FINGERS]) -> Sample {
    let value = places.iter().map(|place| place.value).sum::<f64>() / FINGERS as f64;
    let half = places.iter().map(|place| place.half * place.half).sum::<f64>().sqrt() / FINGERS as f64;
    Sample { value, half }
}

/// Encoder biases of a finger's joints that bend first and second, from how much farther `up` and `ahead` than the others it finds the
/// keyboard, m; without the latter, that of the first alone. `turns` is how far the fingertip moves with the joints, m/rad.
fn biases(finger: usize, turns: &Matrix3x2<f64>, up: Sample, ahead: Option<Sample>) -> Vec<Measured> {
    let bias = |bend: usize, value: f64, half: f64| bias(finger, FIRST_BEND + bend, Sample { value, half });
    let both = Matrix2::from_fn(|axis, bend| turns[(bend, axis)]);
    let Some((ahead, inverse)) = ahead.zip(both.try_inverse()) else {
        let turn = turns[(0, 1)];
        return vec![bias(0, up.value / turn, up.half / turn.abs())];
    };
    let of = |bend: usize| {
        let [of_ahead, of_up] = [inverse[(bend, 0)], inverse[(bend, 1)]];
        let value = of_ahead * ahead.value + of_up * up.value;
        bias(bend, value, (of_ahead * ahead.half).hypot(of_up * up.half))
    };
    vec![of(0), of(1)]
}

/// What slow presses showed, in a sentence; none if no motion presses keys slowly.
pub fn in_words(motions: &[Motion], measured: &[Measured]) -> Option<String> {
    motions.iter().any(Motion::presses_keys).then(|| {
        let value = |quantity: WorldRow| {
            let one = measured.iter().find(|one| one.path == quantity.row().name)?;
            Some(one.value)
        };
        let places = value(WorldRow::KeyThreshold)
            .zip(value(WorldRow::KeyHysteresis))
            .zip(value(WorldRow::KeyboardHeight));
        let Some(((threshold, hysteresis), height)) = places else {
            return format!(
                "slow presses show nothing: each finger must press {FEWEST} keys to their bottom; see that the keyboard is in its place, \
                 and record the excitation `keys` again"
            );
        };
        let silent = threshold * (1.0 - hysteresis);
        let force = value(WorldRow::KeyPreload)
            .map_or_else(String::new, |force| format!(", and {force:.2} N move it from rest"));
        let place = |quantity: WorldRow, way: &str, unknown: &str| {
            value(quantity).map_or_else(
                || format!("; how far {way} was not measured, since {unknown}: an earlier value stays"),
                |place| format!(", {:+.1} mm {way}", 1e3 * place),
            )
        };
        let aside = place(
            WorldRow::KeyboardLateral,
            "toward the high notes",
            "a finger has not made both keys beside a gap sound",
        );
        let ahead = place(WorldRow::KeyboardDepth, "toward the player", "a finger has met too few black keys");
        format!(
            "a key sounds at {threshold:.2} of its travel and is silent again at {silent:.2}{force}; the keyboard is {:+.1} mm high{aside}{ahead}",
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

/// A mean and half its 95 % interval.
#[derive(Clone, Copy)]
struct Sample {
    value: f64,
    half: f64,
}

impl Sample {
    /// With an error that all values share.
    fn with(self, half: f64) -> Self {
        Self { half: self.half.hypot(half), ..self }
    }

    /// Less the other's value; its own error stays.
    fn minus(self, other: Self) -> Self {
        Self { value: self.value - other.value, ..self }
    }

    fn within(self, path: String, [low, high]: [f64; 2]) -> Measured {
        let [value, from, to] =
            [self.value, self.value - self.half, self.value + self.half].map(|value| value.clamp(low, high));
        Measured { path, value, interval: [from, to] }
    }
}

fn world(quantity: WorldRow, sample: Sample) -> Measured {
    let row = quantity.row();
    sample.within(row.name.to_string(), row.range)
}

/// The encoder bias of a finger's joint, counted from its base.
fn bias(finger: usize, joint: usize, sample: Sample) -> Measured {
    let row = JointRow::EncoderBias.row();
    let name = JOINT_NAMES[finger * JOINTS_PER_FINGER + joint];
    sample.within(format!("joint.{name}.{}", row.name), row.range)
}

/// Mean of at least two values.
fn mean(values: &[f64]) -> Sample {
    let count = values.len() as f64;
    let value = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|other| (other - value).powi(2)).sum::<f64>() / (count - 1.0);
    Sample { value, half: student(count - 1.0) * (variance / count).sqrt() }
}

/// Student's t for 95 % (Abramowitz and Stegun 26.7.5, three terms): 4 % too small with two degrees of freedom, 0.5 % with eight.
fn student(freedom: f64) -> f64 {
    1.96 + 2.372 / freedom + 2.823 / (freedom * freedom) + 2.556 / freedom.powi(3)
}

/// A motion of a hand.
struct Hand<'a> {
    motion: &'a Motion,
    params: &'a PhysicalParams,
    side: Side,
    /// How far toward the player the keyboard is, m.
    depth: f64,
}

impl<'a> Hand<'a> {
    /// The slow presses from which a white key sounds until it is silent, with the finger over its middle.
    fn presses(&'a self) -> Vec<Press<'a>> {
        let events = &self.motion.keys;
        let pair = |(index, event): (usize, &etude_music::KeyEvent)| {
            let end = events[index + 1..].iter().find(|other| other.key == event.key)?;
            (event.velocity > 0 && end.velocity == 0)
                .then(|| self.press(event.key, [event.secs, end.secs]))?
        };
        events.iter().enumerate().filter_map(pair).collect()
    }

    fn press(&'a self, key: usize, [sounds, silent]: [f64; 2]) -> Option<Press<'a>> {
        let finger = self.finger_over(key, sounds)?;
        if key_is_black(key) || aside::is_beside(self, finger, key, sounds) {
            return None;
        }
        let travel = |secs: f64| self.travel(key, finger, secs);
        let speed = |secs: f64| (travel(secs + 0.01) - travel(secs - 0.01)) / 0.02;
        if [sounds, silent].into_iter().any(|secs| speed(secs).abs() > FASTEST) {
            return None;
        }
        let inside = self.indices([sounds, silent]);
        let mut down: Vec<f64> = inside.clone().map(|index| self.travel_at(key, finger, index)).collect();
        down.sort_by(f64::total_cmp);
        // Not the very deepest reading, which has the most noise.
        let deepest = *down.get((down.len() * 9 / 10).min(down.len().checked_sub(1)?))?;
        let (near, least_secs) = BOTTOM;
        let at_bottom = down.iter().filter(|travel| **travel > deepest - near).count();
        let period = (silent - sounds) / down.len() as f64;
        if at_bottom as f64 * period < least_secs {
            return None;
        }
        let middle = inside.start.midpoint(inside.end);
        let (shape, angles) = (KeyShape::of(key), self.angles(finger, middle));
        let tip = kinematics::fingertip(self.side, finger, &angles, 0.0);
        Some(Press {
            hand: self,
            key,
            finger,
            secs: [sounds, silent],
            places: [travel(sounds), travel(silent), deepest],
            travel_m: self.lever(shape, tip[0]) * shape.max_angle(),
            turns: self.jacobian(finger, &angles),
        })
    }

    /// The finger whose tip is over a key.
    fn finger_over(&self, key: usize, secs: f64) -> Option<usize> {
        let index = self.indices([secs, f64::INFINITY]).start;
        let aside = |finger: usize| Some(((self.lateral(finger, index)? - key_lateral(key)).abs(), finger));
        let (aside, nearest) = (0..FINGERS).filter_map(aside).min_by(|(a, _), (b, _)| a.total_cmp(b))?;
        (aside < WHITE_PITCH / 2.0).then_some(nearest)
    }

    /// Where a fingertip should be at a control step, m; none after the last, and where set-points were sent.
    fn target(&self, finger: usize, step: usize) -> Option<[f64; 3]> {
        let Commands::Targets(targets) = &self.motion.commands else { return None };
        let targets = targets.get(step)?;
        let angles = std::array::from_fn(|joint| targets[finger * JOINTS_PER_FINGER + joint]);
        Some(kinematics::fingertip(self.side, finger, &angles, targets[RAIL]))
    }

    /// Where a fingertip is along the keyboard, m; none without a reading of the rail.
    fn lateral(&self, finger: usize, index: usize) -> Option<f64> {
        let rails = &self.motion.rail;
        let next = rails.partition_point(|(at, _)| *at < self.motion.fingers[index].0);
        let (_, rail) = rails.get(next).or(rails.last())?;
        Some(kinematics::fingertip(self.side, finger, &self.angles(finger, index), *rail)[1])
    }

    /// The readings between two times.
    fn indices(&self, [from, to]: [f64; 2]) -> std::ops::Range<usize> {
        let fingers = &self.motion.fingers;
        let last = fingers.len().saturating_sub(1);
        let index = |secs: f64| fingers.partition_point(|(at, _)| *at < secs).min(last);
        index(from)..index(to)
    }

    fn angles(&self, finger: usize, index: usize) -> [f64; JOINTS_PER_FINGER] {
        let (_, angles) = &self.motion.fingers[index];
        std::array::from_fn(|joint| angles[finger * JOINTS_PER_FINGER + joint])
    }

    /// How far down a fingertip holds a key: 0 at rest, 1 at the bottom.
    fn travel_at(&self, key: usize, finger: usize, index: usize) -> f64 {
        let tip = kinematics::fingertip(self.side, finger, &self.angles(finger, index), 0.0);
        let shape = KeyShape::of(key);
        (shape.top() + TIP_RADIUS - tip[2]) / (self.lever(shape, tip[0]) * shape.max_angle())
    }

    /// The same between readings.
    fn travel(&self, key: usize, finger: usize, secs: f64) -> f64 {
        let next = self.indices([secs, f64::INFINITY]).start.max(1);
        let [(before, _), (after, _)] = [self.motion.fingers[next - 1], self.motion.fingers[next]];
        let share = ((secs - before) / (after - before)).clamp(0.0, 1.0);
        let [from, to] = [next - 1, next].map(|index| self.travel_at(key, finger, index));
        from + share * (to - from)
    }

    /// How far from the hinge of a key a place along `x` presses it, m.
    fn lever(&self, shape: &KeyShape, x: f64) -> f64 {
        x - self.depth - shape.x + shape.size[0] / 2.0
    }

    /// Change of a fingertip's place along `x` and `z` with each of the joints that bend, m/rad.
    fn jacobian(&self, finger: usize, angles: &[f64; JOINTS_PER_FINGER]) -> Matrix3x2<f64> {
        let turns: [_; 3] = std::array::from_fn(|bend| self.turn(finger, angles, FIRST_BEND + bend));
        Matrix3x2::from_fn(|bend, axis| turns[bend][2 * axis])
    }

    /// Change of a fingertip's place with one joint of the finger, m/rad.
    fn turn(&self, finger: usize, angles: &[f64; JOINTS_PER_FINGER], joint: usize) -> [f64; 3] {
        let place = |angles: &[f64; JOINTS_PER_FINGER]| kinematics::fingertip(self.side, finger, angles, 0.0);
        let mut turned = *angles;
        turned[joint] += STEP_RAD;
        let [from, to] = [place(angles), place(&turned)];
        std::array::from_fn(|axis| (to[axis] - from[axis]) / STEP_RAD)
    }

    /// Torque at the hinge of `key` with which the finger presses, N·m: that of the force which explains the duties best.
    fn hinge_torque(&self, key: usize, finger: usize, index: usize) -> Option<f64> {
        let angles = self.angles(finger, index);
        let mut positions = [0.0; allegro::JOINTS];
        positions[..RAIL].copy_from_slice(&self.motion.fingers[index].1);
        // Fingers that the rig does not hold are taken to weigh nothing, as those of a twin without gravity.
        let has_weight = self.motion.rig.joint_loop.gravity_pwm_per_nm > 0.0;
        let holding = if has_weight { holding_torques(&positions) } else { [0.0; allegro::JOINTS] };
        let duties = self.motion.pwm.get(index)?;
        let torques = Vector3::from_fn(|bend, _| {
            let joint = finger * JOINTS_PER_FINGER + FIRST_BEND + bend;
            duties[joint] * self.torque_of_duty(joint) - holding[joint]
        });
        let jacobian = self.jacobian(finger, &angles);
        let force = (jacobian.transpose() * jacobian).try_inverse()? * jacobian.transpose() * torques;
        let tip = kinematics::fingertip(self.side, finger, &angles, 0.0);
        let shape = KeyShape::of(key);
        // The rounded tip touches the key's slope a little behind its own middle.
        let angle = self.travel_at(key, finger, index).clamp(0.0, 1.0) * shape.max_angle();
        let above = tip[2] - TIP_RADIUS * angle.cos() - shape.z;
        let ahead = self.lever(shape, tip[0]) - TIP_RADIUS * angle.sin();
        Some(force[0] * above - force[1] * ahead)
    }

    /// Torque of a joint for each unit of its duty, N·m, as the simulator has it.
    fn torque_of_duty(&self, joint: usize) -> f64 {
        let gain = self.motion.rig.joint_loop.kp[joint % JOINTS_PER_FINGER];
        self.params.joint(JointRow::Stiffness, joint) / gain
    }

    /// Torque of a key at rest, N·m, and its growth, N·m/rad: by least squares over a press, of which `lower` is how much lower the key
    /// is than the nominal one.
    fn spring(&self, key: usize, finger: usize, secs: [f64; 2], lower: f64) -> Option<[f64; 2]> {
        let (mut rows, mut torques) = (Vec::new(), Vec::new());
        let readings = self.indices(secs);
        let last = self.motion.fingers.len().saturating_sub(SIDE);
        for index in readings.start.max(SIDE)..readings.end.min(last) {
            let travel = |index: usize| self.travel_at(key, finger, index) - lower;
            let [before, after] = [index - SIDE, index + SIDE];
            let secs = self.motion.fingers[after].0 - self.motion.fingers[before].0;
            let (place, speed) = (travel(index), (travel(after) - travel(before)) / secs);
            let within = |[low, high]: [f64; 2]| (low..=high).contains(&place);
            let touches = if within(PRESSES) { 1.0 } else { 0.0 };
            if speed.abs() < MOVING || speed.abs() > FASTEST || !(within(PRESSES) || within(CLEAR)) {
                continue;
            }
            let way = speed.signum();
            let angle = place * KeyShape::of(key).max_angle();
            rows.push([1.0, way, way * touches, touches, angle * touches]);
            torques.push(self.hinge_torque(key, finger, index)?);
        }
        let matrix = DMatrix::from_fn(rows.len(), UNKNOWNS, |row, column| rows[row][column]);
        let normal = matrix.transpose() * &matrix;
        let solved = normal.try_inverse()? * matrix.transpose() * DVector::from_vec(torques);
        // Not of a rig without gains.
        (solved[3].is_finite() && solved[4].is_finite()).then_some([solved[3], solved[4]])
    }
}
