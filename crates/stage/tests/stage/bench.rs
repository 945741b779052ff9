//! What the tests share: poses over keys, and random but shrinkable ways to move.

use etude_stage::geometry::{HALF_WIDTH, KeyShape};
use etude_stage::hand::{JOINTS_PER_FINGER, TIP_RADIUS, root_lateral};
use etude_stage::params::{JointRow, WorldRow};
use etude_stage::{
    DRIVEN_JOINTS, FINGERS, PhysicalParams, RAIL, StageConfig, World, joint_range, kinematics,
};
use proptest::prelude::*;

/// A nominal world of the default kind.
pub fn nominal() -> World {
    World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap()
}

/// Targets with `finger`'s tip `height` metres above the top of `key` (negative: pressed that
/// deep), the other fingers hovering as at the start. `None` where the finger cannot get there.
pub fn over(world: &World, finger: usize, key: usize, height: f64) -> Option<[f64; DRIVEN_JOINTS]> {
    over_beside(world, finger, key, height, 0.0)
}

/// As [`over`], with the tip `aside` metres to the right of the key's middle while the rail stays
/// over the middle.
pub fn over_beside(
    world: &World,
    finger: usize,
    key: usize,
    height: f64,
    aside: f64,
) -> Option<[f64; DRIVEN_JOINTS]> {
    let side = world.config().side;
    let [x, y, _] = world.key_target(key);
    let top = KeyShape::of(key).top() + world.params().world(WorldRow::KeyboardHeight);
    let rail = y - root_lateral(side, finger);
    if rail.abs() > HALF_WIDTH {
        return None;
    }
    let mut pose = world.start_pose();
    let angles = kinematics::reach(side, finger, [x, y + aside, top + TIP_RADIUS + height], rail)?;
    pose[RAIL] = rail + world.params().joint(JointRow::EncoderBias, RAIL);
    for (number, angle) in angles.into_iter().enumerate() {
        let joint = finger * JOINTS_PER_FINGER + number;
        pose[joint] = angle + world.params().joint(JointRow::EncoderBias, joint);
    }
    Some(pose)
}

/// Targets at these shares (0 to 1) of the joints' ranges.
pub fn at_shares(shares: &[f64; DRIVEN_JOINTS]) -> [f64; DRIVEN_JOINTS] {
    std::array::from_fn(|joint| {
        let [low, high] = joint_range(joint);
        low + shares[joint] * (high - low)
    })
}

/// One way to move for a few control steps.
#[derive(Clone, Debug)]
pub enum Gesture {
    /// A finger to a place over, on or deep in a key.
    Reach {
        /// Which finger.
        finger: usize,
        /// Which key.
        key: usize,
        /// Height over the key, m.
        height: f64,
        /// Control steps.
        steps: usize,
    },
    /// All joints anywhere.
    Fling {
        /// Shares of the joints' ranges.
        shares: [f64; DRIVEN_JOINTS],
        /// Control steps.
        steps: usize,
    },
}

impl Gesture {
    /// The targets, once for each control step.
    pub fn targets(&self, world: &World) -> Vec<[f64; DRIVEN_JOINTS]> {
        match self {
            Gesture::Reach { finger, key, height, steps } => {
                vec![over(world, *finger, *key, *height).unwrap_or_else(|| world.start_pose()); *steps]
            }
            Gesture::Fling { shares, steps } => vec![at_shares(shares); *steps],
        }
    }
}

/// Targets of all gestures, one after the other.
pub fn all_targets(world: &World, gestures: &[Gesture]) -> Vec<[f64; DRIVEN_JOINTS]> {
    gestures.iter().flat_map(|gesture| gesture.targets(world)).collect()
}

/// Some gestures near the middle of the keyboard, most of them presses.
pub fn gestures() -> impl Strategy<Value = Vec<Gesture>> {
    let reach = (0..FINGERS, 20usize..30, -0.02f64..0.005, 2usize..14)
        .prop_map(|(finger, key, height, steps)| Gesture::Reach { finger, key, height, steps });
    let fling = (prop::array::uniform13(0.0f64..1.0), 1usize..6)
        .prop_map(|(shares, steps)| Gesture::Fling { shares, steps });
    prop::collection::vec(prop_oneof![3 => reach, 1 => fling], 1..7)
}

/// Settings of the property tests: physics is dear, so few cases.
pub fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// Any world: side, fences, actuation, interlock.
pub fn config() -> impl Strategy<Value = StageConfig> {
    use etude_stage::{Actuation, Side};
    let side = prop_oneof![Just(Side::Left), Just(Side::Right)];
    let actuation = prop_oneof![Just(Actuation::Controlled), Just(Actuation::Position)];
    (side, any::<bool>(), actuation, any::<bool>())
        .prop_map(|(side, fences, actuation, interlock)| StageConfig { side, fences, actuation, interlock })
}
