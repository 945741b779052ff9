//! A hand in a recording of slow presses: where its fingertips are, by the encoders, and where they
//! should be.

use etude_music::CONTROL_HZ;
use etude_stage::geometry::{KeyShape, WHITE_PITCH, key_lateral};
use etude_stage::hand::{FINGERS, JOINTS_PER_FINGER, TIP_RADIUS};
use etude_stage::params::JointRow;
use etude_stage::{PhysicalParams, RAIL, Side, kinematics};
use nalgebra::Matrix3x2;

use crate::motion::{Commands, RecordedMotion};
use crate::parameter_bounds::FIRST_BEND;

/// A press farther than this from the middle of a key is one beside its gap, m.
pub(super) const OFF_MIDDLE_M: f64 = 0.003;
/// Step of the differences for a Jacobian, rad.
const STEP_RAD: f64 = 1e-6;

/// A motion of a hand.
pub(super) struct Hand<'a> {
    pub motion: &'a RecordedMotion,
    pub params: &'a PhysicalParams,
    pub side: Side,
    /// How far toward the player the keyboard is, m.
    pub depth: f64,
}

impl Hand<'_> {
    /// Whether the target of a finger is beside the middle of a key at a time.
    pub fn targets_gap(&self, finger: usize, key: usize, secs: f64) -> bool {
        self.target(finger, (secs * CONTROL_HZ) as usize)
            .is_some_and(|tip| (tip[1] - key_lateral(key)).abs() > OFF_MIDDLE_M)
    }

    /// The finger whose tip is over a key.
    pub fn finger_over(&self, key: usize, secs: f64) -> Option<usize> {
        let index = self.indices([secs, f64::INFINITY]).start;
        let distance =
            |finger: usize| Some(((self.lateral(finger, index)? - key_lateral(key)).abs(), finger));
        let (distance, nearest) =
            (0..FINGERS).filter_map(distance).min_by(|(a, _), (b, _)| a.total_cmp(b))?;
        (distance < WHITE_PITCH / 2.0).then_some(nearest)
    }

    /// Where a fingertip should be at a control step, m; none after the last, and where set-points
    /// were sent.
    pub fn target(&self, finger: usize, step: usize) -> Option<[f64; 3]> {
        let Commands::Targets(targets) = &self.motion.commands else { return None };
        let targets = targets.get(step)?;
        let angles = std::array::from_fn(|joint| targets[finger * JOINTS_PER_FINGER + joint]);
        Some(kinematics::fingertip(self.side, finger, &angles, targets[RAIL]))
    }

    /// Where a fingertip is along the keyboard, m; none without a reading of the rail.
    pub fn lateral(&self, finger: usize, index: usize) -> Option<f64> {
        let rails = &self.motion.rail;
        let next = rails.partition_point(|(at, _)| *at < self.motion.fingers[index].0);
        let (_, rail) = rails.get(next).or(rails.last())?;
        Some(kinematics::fingertip(self.side, finger, &self.angles(finger, index), *rail)[1])
    }

    /// The readings between two times.
    pub fn indices(&self, [from, to]: [f64; 2]) -> std::ops::Range<usize> {
        let fingers = &self.motion.fingers;
        let last = fingers.len().saturating_sub(1);
        let index = |secs: f64| fingers.partition_point(|(at, _)| *at < secs).min(last);
        index(from)..index(to)
    }

    pub fn angles(&self, finger: usize, index: usize) -> [f64; JOINTS_PER_FINGER] {
        let (_, angles) = &self.motion.fingers[index];
        std::array::from_fn(|joint| angles[finger * JOINTS_PER_FINGER + joint])
    }

    /// How far down a fingertip holds a key: 0 at rest, 1 at the bottom.
    pub fn travel_at(&self, key: usize, finger: usize, index: usize) -> f64 {
        let tip = kinematics::fingertip(self.side, finger, &self.angles(finger, index), 0.0);
        let shape = KeyShape::of(key);
        (shape.top() + TIP_RADIUS - tip[2]) / (self.lever_arm(shape, tip[0]) * shape.max_angle())
    }

    /// The same between readings.
    pub fn travel(&self, key: usize, finger: usize, secs: f64) -> f64 {
        let next = self.indices([secs, f64::INFINITY]).start.max(1);
        let [(before, _), (after, _)] = [self.motion.fingers[next - 1], self.motion.fingers[next]];
        let share = ((secs - before) / (after - before)).clamp(0.0, 1.0);
        let [from, to] = [next - 1, next].map(|index| self.travel_at(key, finger, index));
        from + share * (to - from)
    }

    /// How far from the hinge of a key a position along `x` presses it, m.
    pub fn lever_arm(&self, shape: &KeyShape, x: f64) -> f64 {
        x - self.depth - shape.x + shape.size[0] / 2.0
    }

    /// Change of a fingertip's position along `x` and `z` with each of the joints that bend, m/rad.
    pub fn jacobian(&self, finger: usize, angles: &[f64; JOINTS_PER_FINGER]) -> Matrix3x2<f64> {
        let columns: [_; 3] = std::array::from_fn(|bend| self.moved_by(finger, angles, FIRST_BEND + bend));
        Matrix3x2::from_fn(|bend, axis| columns[bend][2 * axis])
    }

    /// Change of a fingertip's position with one joint of the finger, m/rad.
    pub fn moved_by(&self, finger: usize, angles: &[f64; JOINTS_PER_FINGER], joint: usize) -> [f64; 3] {
        let tip = |angles: &[f64; JOINTS_PER_FINGER]| kinematics::fingertip(self.side, finger, angles, 0.0);
        let mut moved = *angles;
        moved[joint] += STEP_RAD;
        let [from, to] = [tip(angles), tip(&moved)];
        std::array::from_fn(|axis| (to[axis] - from[axis]) / STEP_RAD)
    }

    /// Torque of a joint for each unit of its duty, N·m, as the simulator has it.
    pub fn torque_of_duty(&self, joint: usize) -> f64 {
        let gain = self.motion.rig.joint_loop.kp[joint % JOINTS_PER_FINGER];
        self.params.joint(JointRow::Stiffness, joint) / gain
    }
}
