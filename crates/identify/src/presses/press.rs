//! Slow presses of white keys: where the key sounds and how hard it pushes back.

use etude_music::key_is_black;
use etude_robot::allegro::{self, holding_torques};
use etude_stage::geometry::KeyShape;
use etude_stage::hand::{JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::{RAIL, kinematics};
use nalgebra::{DMatrix, DVector, Matrix3x2, Vector3};

use super::hand::Hand;
use crate::parameter_bounds::FIRST_BEND;

/// A finger that passes a contact faster has slipped, travels a second.
const MAX_SPEED: f64 = 5.0;
/// A key is at its bottom if it stays within this share of its travel of its deepest position, for
/// at least this time, s.
const BOTTOM: (f64, f64) = (0.04, 0.25);
/// Time before a key sounds, and after it is silent, in which its finger comes and goes, s.
const AROUND_SECS: f64 = 1.2;
/// Readings to each side from which a speed is taken.
const HALF_WINDOW: usize = 8;
/// A joint that is slower may be held by its friction, travels a second.
const MIN_SPEED: f64 = 0.5;
/// Shares of travel in which a finger is clear of the key, and in which it presses it.
const CLEAR: [f64; 2] = [-0.5, -0.12];
const PRESSES: [f64; 2] = [0.15, 0.9];
/// Unknowns of the force on a press: its zero, the finger's friction, what the key adds to that,
/// the force at rest, and the spring.
const UNKNOWNS: usize = 5;

/// A press: shares of the simulated key's travel, of a keyboard at its nominal height.
pub(super) struct Press<'a> {
    hand: &'a Hand<'a>,
    key: usize,
    pub finger: usize,
    /// When the key begins to sound, and when it is silent again, s.
    secs: [f64; 2],
    /// Where the key sounds.
    pub sounds_at: f64,
    /// Where it is silent again.
    pub silent_at: f64,
    pub bottom: f64,
    /// Travel under the fingertip, m.
    pub travel_m: f64,
    /// How far along `x` and `z` the tip moves with the joints that bend, m/rad.
    pub jacobian: Matrix3x2<f64>,
}

impl Press<'_> {
    /// Torque at the hinge of the key at rest, N·m, and its growth, N·m/rad.
    pub fn spring(&self) -> Option<[f64; 2]> {
        let [sounds, silent] = self.secs;
        let around = [sounds - AROUND_SECS, silent + AROUND_SECS];
        self.hand.spring(self.key, self.finger, around, self.bottom - 1.0)
    }
}

/// The slow presses of white keys in recordings.
pub(super) fn presses<'a>(hands: &'a [Hand<'a>]) -> Vec<Press<'a>> {
    hands.iter().flat_map(Hand::presses).collect()
}

impl<'a> Hand<'a> {
    /// The slow presses from which a white key sounds until it is silent, with the finger over its
    /// middle.
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
        if key_is_black(key) || self.targets_gap(finger, key, sounds) {
            return None;
        }
        let travel = |secs: f64| self.travel(key, finger, secs);
        let speed = |secs: f64| (travel(secs + 0.01) - travel(secs - 0.01)) / 0.02;
        if [sounds, silent].into_iter().any(|secs| speed(secs).abs() > MAX_SPEED) {
            return None;
        }
        let inside = self.indices([sounds, silent]);
        let mut down: Vec<f64> = inside.clone().map(|index| self.travel_at(key, finger, index)).collect();
        down.sort_by(f64::total_cmp);
        // Not the very deepest reading, which has the most noise.
        let deepest = *down.get((down.len() * 9 / 10).min(down.len().checked_sub(1)?))?;
        let (width, min_secs) = BOTTOM;
        let at_bottom = down.iter().filter(|travel| **travel > deepest - width).count();
        let period = (silent - sounds) / down.len() as f64;
        if at_bottom as f64 * period < min_secs {
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
            sounds_at: travel(sounds),
            silent_at: travel(silent),
            bottom: deepest,
            travel_m: self.lever_arm(shape, tip[0]) * shape.max_angle(),
            jacobian: self.jacobian(finger, &angles),
        })
    }

    /// Torque at the hinge of `key` with which the finger presses, N·m: that of the force which
    /// explains the duties best.
    fn hinge_torque(&self, key: usize, finger: usize, index: usize) -> Option<f64> {
        let angles = self.angles(finger, index);
        let mut positions = [0.0; allegro::WIRE_JOINTS];
        positions[..RAIL].copy_from_slice(&self.motion.fingers[index].1);
        // Fingers that the rig does not hold are taken to weigh nothing, as those of a twin without
        // gravity.
        let has_weight = self.motion.rig.joint_loop.gravity_pwm_per_nm > 0.0;
        let holding = if has_weight { holding_torques(&positions) } else { [0.0; allegro::WIRE_JOINTS] };
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
        let ahead = self.lever_arm(shape, tip[0]) - TIP_RADIUS * angle.sin();
        Some(force[0] * above - force[1] * ahead)
    }

    /// Torque of a key at rest, N·m, and its growth, N·m/rad: by least squares over a press, of
    /// which `lower` is how much lower the key is than the nominal one.
    fn spring(&self, key: usize, finger: usize, secs: [f64; 2], lower: f64) -> Option<[f64; 2]> {
        let (mut rows, mut torques) = (Vec::new(), Vec::new());
        let readings = self.indices(secs);
        let last = self.motion.fingers.len().saturating_sub(HALF_WINDOW);
        for index in readings.start.max(HALF_WINDOW)..readings.end.min(last) {
            let travel = |index: usize| self.travel_at(key, finger, index) - lower;
            let [before, after] = [index - HALF_WINDOW, index + HALF_WINDOW];
            let secs = self.motion.fingers[after].0 - self.motion.fingers[before].0;
            let (position, speed) = (travel(index), (travel(after) - travel(before)) / secs);
            let within = |[low, high]: [f64; 2]| (low..=high).contains(&position);
            let touches = if within(PRESSES) { 1.0 } else { 0.0 };
            if speed.abs() < MIN_SPEED || speed.abs() > MAX_SPEED || !(within(PRESSES) || within(CLEAR)) {
                continue;
            }
            let direction = speed.signum();
            let angle = position * KeyShape::of(key).max_angle();
            rows.push([1.0, direction, direction * touches, touches, angle * touches]);
            torques.push(self.hinge_torque(key, finger, index)?);
        }
        let matrix = DMatrix::from_fn(rows.len(), UNKNOWNS, |row, column| rows[row][column]);
        let normal = matrix.transpose() * &matrix;
        let solved = normal.try_inverse()? * matrix.transpose() * DVector::from_vec(torques);
        // Not of a rig without gains.
        (solved[3].is_finite() && solved[4].is_finite()).then_some([solved[3], solved[4]])
    }
}
