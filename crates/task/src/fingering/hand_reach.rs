//! Where the fingertips can be over the keys, and from which positions of the rail.

use etude_music::key_is_black;
use etude_stage::geometry::{BLACK, FENCE_RISE, HALF_WIDTH, KeyShape, WHITE, key_target};
use etude_stage::hand::TIP_RADIUS;
use etude_stage::params::WorldRow;
use etude_stage::{PhysicalParams, Side, kinematics};

/// Clearance of a waiting fingertip over its key, m: above the fences, low enough for a quick
/// strike.
const HOVER_M: f64 = 0.006;
/// Clearance over black keys while a finger moves to or from one, m.
const CROSSING_M: f64 = 0.010;
/// Depth of a strike as a fraction of the key's travel. It is above 1 because the reference slows
/// down near its target and because the springs of key and joints yield.
const STRIKE_DEPTH: f64 = 1.2;
/// Lateral distance that a waiting finger keeps from a neighbour that plays, m.
const MIN_NEIGHBOUR_M: f64 = 0.0255;
/// A finger that is farther than this to the side of its key turns over it first and strikes one
/// control step later, m. Else it comes down on a fence, since it bends faster than it turns.
pub(crate) const TURN_FIRST_M: f64 = 0.008;
/// How far a fingertip may be to either side of its position with an unturned root, m.
pub(crate) const LATERAL_REACH_M: f64 = 0.020;
/// Where white keys are pressed, m toward the player from their middle.
const WHITE_X_M: f64 = 0.028;
/// Where black keys are pressed, m toward the player from their middle: near the front, close to
/// the white keys.
const BLACK_X_M: f64 = 0.034;

/// How far toward the player from [`key_target`] a fingering presses `key`, m.
pub(crate) fn beyond_target(key: usize) -> f64 {
    let x = if key_is_black(key) { BLACK.x + BLACK_X_M } else { WHITE.x + WHITE_X_M };
    x - key_target(key)[0]
}

/// Positions for the centres of the fingertips, in the world frame.
pub(crate) struct HandReach {
    side: Side,
    keyboard: [f64; 3],
}

impl HandReach {
    pub(crate) fn new(side: Side, params: &PhysicalParams) -> Self {
        let keyboard = [WorldRow::KeyboardDepth, WorldRow::KeyboardLateral, WorldRow::KeyboardHeight]
            .map(|row| params.world(row));
        Self { side, keyboard }
    }

    /// Position `[x, y]` over a key, m.
    pub(crate) fn over(&self, key: usize) -> [f64; 2] {
        let [x, y, _] = key_target(key);
        [x + beyond_target(key) + self.keyboard[0], y + self.keyboard[1]]
    }

    /// Height of a waiting fingertip over `key`, m.
    pub(crate) fn hover_height(&self, key: usize) -> f64 {
        KeyShape::of(key).top() + TIP_RADIUS + HOVER_M.max(FENCE_RISE) + self.keyboard[2]
    }

    /// Height at which a fingertip passes over black keys, m.
    pub(crate) fn crossing_height(&self) -> f64 {
        BLACK.top() + TIP_RADIUS + CROSSING_M + self.keyboard[2]
    }

    /// Height that a strike of `key` aims for, m.
    pub(crate) fn pressed_height(&self, key: usize) -> f64 {
        let shape = KeyShape::of(key);
        let from_hinge = self.over(key)[0] - self.keyboard[0] - shape.x + shape.size[0] / 2.0;
        let travel = shape.max_angle() * from_hinge;
        shape.top() + TIP_RADIUS - STRIKE_DEPTH * travel + self.keyboard[2]
    }

    /// Lateral position of a fingertip at depth `x` when the finger's root is not turned and the
    /// rail is centred, m.
    pub(crate) fn unturned(&self, finger: usize, x: f64) -> f64 {
        // An unturned finger moves in one upright plane, which two of its poses define.
        let straight = kinematics::fingertip(self.side, finger, &[0.0; 4], 0.0);
        let bent =
            kinematics::fingertip(self.side, finger, &[0.0, std::f64::consts::FRAC_PI_2, 0.0, 0.0], 0.0);
        straight[1] + (bent[1] - straight[1]) * (x - straight[0]) / (bent[0] - straight[0])
    }

    /// The lateral position nearest to `[x, y]` at which `finger` is clear of its neighbour
    /// `other`, which plays at `other_y`, m.
    pub(crate) fn clear_of(&self, finger: usize, [x, y]: [f64; 2], other: usize, other_y: f64) -> f64 {
        let above = self.unturned(finger, x) > self.unturned(other, x);
        if above { y.max(other_y + MIN_NEIGHBOUR_M) } else { y.min(other_y - MIN_NEIGHBOUR_M) }
    }

    /// Rail positions from which `finger` can play `key`, m.
    pub(crate) fn rail_interval(&self, finger: usize, key: usize) -> [f64; 2] {
        let [x, y] = self.over(key);
        let rail = y - self.unturned(finger, x);
        [(rail - LATERAL_REACH_M).max(-HALF_WIDTH), (rail + LATERAL_REACH_M).min(HALF_WIDTH)]
    }

    /// Joint angles that bring a fingertip to `target`, or as near to it laterally as the finger
    /// reaches.
    pub(crate) fn joint_angles(&self, finger: usize, target: [f64; 3], rail: f64) -> Option<[f64; 4]> {
        let [x, y, z] = target;
        let unturned = self.unturned(finger, x) + rail;
        // A little more than is planned with: the rail is not always where it is planned to be.
        let reach = LATERAL_REACH_M * 1.25;
        let y = y.clamp(unturned - reach, unturned + reach);
        kinematics::reach(self.side, finger, [x, y, z], rail)
            .or_else(|| kinematics::reach(self.side, finger, [x, unturned, z], rail))
    }
}
