//! The comb of fingertips over the keys: where the rail must be for a finger to play a key.

use etude_music::key_is_black;
use etude_stage::geometry::{BLACK, FENCE_RISE, HALF_WIDTH, KeyShape, WHITE, key_target};
use etude_stage::hand::TIP_RADIUS;
use etude_stage::params::World;
use etude_stage::{PhysicalParams, Side, kinematics};

use super::ScriptedConfig;

/// Places for fingertips (their centres), in the world.
pub(super) struct Comb {
    side: Side,
    config: ScriptedConfig,
    keyboard: [f64; 3],
}

impl Comb {
    pub(super) fn new(side: Side, params: &PhysicalParams, config: &ScriptedConfig) -> Self {
        let keyboard =
            [World::KeyboardDepth, World::KeyboardLateral, World::KeyboardHeight].map(|q| params.world(q));
        Self { side, config: config.clone(), keyboard }
    }

    /// Place `[x, y]` over a key, m.
    pub(super) fn over(&self, key: usize) -> [f64; 2] {
        let [_, y, _] = key_target(key);
        let black = key_is_black(key);
        let x = if black { BLACK.x + self.config.black_x_m } else { WHITE.x + self.config.white_x_m };
        [x + self.keyboard[0], y + self.keyboard[1]]
    }

    /// Height of a waiting fingertip over `key`, m.
    pub(super) fn hover(&self, key: usize) -> f64 {
        KeyShape::of(key).top() + TIP_RADIUS + self.config.hover_m.max(FENCE_RISE) + self.keyboard[2]
    }

    /// Height at which a fingertip passes over black keys, m.
    pub(super) fn travel(&self) -> f64 {
        BLACK.top() + TIP_RADIUS + self.config.travel_m + self.keyboard[2]
    }

    /// Height that a strike of `key` aims for, m.
    pub(super) fn pressed(&self, key: usize) -> f64 {
        let shape = KeyShape::of(key);
        let from_hinge = self.over(key)[0] - self.keyboard[0] - shape.x + shape.size[0] / 2.0;
        let travel = shape.max_angle() * from_hinge;
        shape.top() + TIP_RADIUS - self.config.depth * travel + self.keyboard[2]
    }

    /// Where a finger's tip is along the keyboard when its root is not turned, for a tip at depth `x`, the rail centred, m.
    pub(super) fn unturned(&self, finger: usize, x: f64) -> f64 {
        // An unturned finger stays in one upright plane; two of its poses give the plane.
        let straight = kinematics::fingertip(self.side, finger, &[0.0; 4], 0.0);
        let bent =
            kinematics::fingertip(self.side, finger, &[0.0, std::f64::consts::FRAC_PI_2, 0.0, 0.0], 0.0);
        straight[1] + (bent[1] - straight[1]) * (x - straight[0]) / (bent[0] - straight[0])
    }

    /// Rail positions from which `finger` can play `key`, m.
    pub(super) fn tube(&self, finger: usize, key: usize) -> [f64; 2] {
        let [x, y] = self.over(key);
        let rail = y - self.unturned(finger, x);
        [(rail - self.config.play_m).max(-HALF_WIDTH), (rail + self.config.play_m).min(HALF_WIDTH)]
    }

    /// Joint angles that bring a fingertip to `target`, or as near to it sideways as the finger's play allows.
    pub(super) fn angles(&self, finger: usize, target: [f64; 3], rail: f64) -> Option<[f64; 4]> {
        let [x, y, z] = target;
        let unturned = self.unturned(finger, x) + rail;
        // A little more than the planned play: the rail is not always where it is planned to be.
        let play = self.config.play_m * 1.25;
        let y = y.clamp(unturned - play, unturned + play);
        kinematics::reach(self.side, finger, [x, y, z], rail)
            .or_else(|| kinematics::reach(self.side, finger, [x, unturned, z], rail))
    }
}
