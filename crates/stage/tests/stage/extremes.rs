//! Within stated bounds, no parameter in its range and no target may make the simulation unstable:
//! a NaN or a silent reset in the middle of a training costs days.
//!
//! Rows span orders of magnitude and are set independently. Some combinations lead to motion too
//! fast for steps of 5 ms, and MuJoCo then resets itself. Three rules exclude them. Each limits one
//! number by an inertia; all others are free.
//!
//! - A key's spring must be stable by itself. MuJoCo integrates springs explicitly and damping
//!   implicitly: a hinge with inertia I, stiffness k and damping d is unstable unless dt²·k <
//!   2·(2·I + dt·d). The lightest keys break this (the black ones, at the smallest armature and
//!   damping, from k = 4.2 on).
//! - A key's preload is a constant torque, which its upper stop resists only from the next step on.
//!   It may carry the lightest key across a tenth of its travel in a step: with the default inertia
//!   that is 3.5 N, and 0.08 N with the least.
//! - A drive must not be too strong for the inertia that is surely there: its armature, and the
//!   whole hand on the rail. By itself and the joint's load it may at most cross its range at a
//!   rate of 0.4 ranges in a step, which for a finger's flexion is three quarters of a radian. What grows with
//!   the square of speed, and links that a neighbour flings about, are integrated explicitly and
//!   feed themselves when they turn by more than a radian in a step. Damping does not count: MuJoCo
//!   leaves it out when it looks for the forces of contacts and stops.

use etude_stage::geometry::BLACK;
use etude_stage::hand::{FINGERS, LINK_MASSES, PALM_MASS, THUMB_MASS};
use etude_stage::params::{JointRow, WorldRow};
use etude_stage::{Actuation, DRIVEN_JOINTS, PhysicalParams, RAIL, StageConfig, World, joint_range};
use proptest::prelude::*;

use crate::bench;
use crate::replica::STEP_SECS;

/// Share of the stiffness at which the lightest key would lose stability. Half, since fingers touch
/// keys.
const KEY_SHARE: f64 = 0.5;
/// How far a key's preload may carry it in a step, as a share of its travel.
const CARRIED: f64 = 0.1;
/// How great a joint's load may be, as a share of the torques on it: half leaves as much to its
/// drive.
const LOAD_SHARE: f64 = 0.5;
/// Fastest that a drive may by itself cross its joint's range, ranges per second.
const FASTEST: f64 = 0.4 / STEP_SECS;

/// Any numbers within the rows' ranges, small and large alike where a row spans decades; a share of
/// exactly 0 or 1 stands for the end of the range. Then what the rules above forbid is taken back
/// to where they begin.
fn params(actuation: Actuation) -> impl Strategy<Value = PhysicalParams> {
    let share = prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.0f64..1.0];
    prop::collection::vec(share, PhysicalParams::rows().count()).prop_map(move |shares| {
        let mut params = PhysicalParams::default();
        for ((path, row, _), share) in PhysicalParams::rows().zip(shares) {
            let [low, high] = row.range;
            let value = if low >= 0.0 && high > 100.0 * low.max(1e-6) {
                let least = low.max(1e-6);
                least * (high / least).powf(share)
            } else {
                low + share * (high - low)
            };
            params.set(&path, value.clamp(low, high)).unwrap();
        }
        keep_to_the_rules(&mut params, actuation);
        params
    })
}

fn keep_to_the_rules(params: &mut PhysicalParams, actuation: Actuation) {
    let stiffest = KEY_SHARE * stiffest_stable_key(params);
    params.set_world(WorldRow::KeyStiffness, params.world(WorldRow::KeyStiffness).min(stiffest));
    let strongest = CARRIED * BLACK.max_angle() / STEP_SECS.powi(2) * lightest_key(params) / BLACK.size[0];
    params.set_world(WorldRow::KeyPreload, params.world(WorldRow::KeyPreload).min(strongest));
    for joint in 0..DRIVEN_JOINTS {
        let load = LOAD_SHARE * largest_torque(params, joint);
        params.set_joint(JointRow::Load, joint, params.joint(JointRow::Load, joint).clamp(-load, load));
        let (quantity, most) = strongest_drive(params, joint, actuation);
        params.set_joint(quantity, joint, params.joint(quantity, joint).min(most));
    }
}

/// Inertia of a black key about its hinge, kg·m².
fn lightest_key(params: &PhysicalParams) -> f64 {
    let [length, _, height] = BLACK.size;
    let box_about_its_rear = BLACK.mass * (length * length / 3.0 + height * height / 12.0);
    box_about_its_rear + params.world(WorldRow::KeyArmature)
}

/// Stiffness from which a black key is unstable, N·m/rad.
fn stiffest_stable_key(params: &PhysicalParams) -> f64 {
    let inertia = lightest_key(params);
    2.0 * (2.0 * inertia + STEP_SECS * params.world(WorldRow::KeyDamping)) / (STEP_SECS * STEP_SECS)
}

/// How great the torques on a joint may be together. All the way from one end of the range to the
/// other, a constant torque reaches v² = 2·range·torque/inertia.
fn largest_torque(params: &PhysicalParams, joint: usize) -> f64 {
    let [low, high] = joint_range(joint);
    let hand = PALM_MASS + THUMB_MASS + FINGERS as f64 * LINK_MASSES.iter().sum::<f64>();
    let inertia = params.joint(JointRow::Armature, joint) + if joint == RAIL { hand } else { 0.0 };
    inertia * FASTEST.powi(2) * (high - low) / 2.0
}

/// The number that says how strong a joint's drive is, and how great it may be beside its load. A
/// spring reaches v² = range²·stiffness/inertia.
fn strongest_drive(params: &PhysicalParams, joint: usize, actuation: Actuation) -> (JointRow, f64) {
    let [low, high] = joint_range(joint);
    let torque = largest_torque(params, joint) - params.joint(JointRow::Load, joint).abs();
    match actuation {
        Actuation::Controlled => (JointRow::TorqueLimit, torque),
        Actuation::Position => (JointRow::Stiffness, 2.0 * torque / (high - low)),
    }
}

fn targets() -> impl Strategy<Value = Vec<[f64; DRIVEN_JOINTS]>> {
    prop::collection::vec((prop::array::uniform13(0.0f64..1.0), 1usize..5), 5..12).prop_map(|moves| {
        moves.iter().flat_map(|(shares, steps)| vec![bench::at_shares(shares); *steps]).collect()
    })
}

fn calm(
    config: &StageConfig,
    params: &PhysicalParams,
    targets: &[[f64; DRIVEN_JOINTS]],
) -> Result<(), TestCaseError> {
    let mut world = World::new(config, params).unwrap();
    for (step, targets) in targets.iter().enumerate() {
        let outcome = world.step(targets);
        let warnings: Vec<i32> = world.data().warning().iter().map(|warning| warning.number).collect();
        prop_assert!(
            warnings.iter().all(|number| *number == 0),
            "MuJoCo warns in step {}: {:?}",
            step,
            warnings
        );
        let numbers = world.data().qpos().iter().chain(world.data().qvel()).chain(world.torques());
        prop_assert!(numbers.copied().all(f64::is_finite));
        prop_assert!(outcome.finger_power.is_finite() && outcome.rail_power.is_finite());
        prop_assert!(!outcome.unstable);
        for event in world.events() {
            prop_assert!(
                (1.0..128.0).contains(&(f64::from(event.velocity.max(1)))) && event.secs.is_finite()
            );
        }
    }
    Ok(())
}

#[test]
fn the_defaults_keep_to_the_rules() {
    let defaults = PhysicalParams::default();
    for actuation in [Actuation::Controlled, Actuation::Position] {
        let mut params = defaults.clone();
        keep_to_the_rules(&mut params, actuation);
        assert_eq!(params, defaults, "{actuation:?}");
    }
}

/// Beyond the first rule: keys that swing up without end once they are touched.
#[test]
fn an_engine_that_starts_over_says_so() {
    let mut params = PhysicalParams::default();
    params.set_world(WorldRow::KeyArmature, 1e-5);
    params.set_world(WorldRow::KeyDamping, 0.001);
    params.set_world(WorldRow::KeyStiffness, 5.0);
    let mut world = World::new(&StageConfig::default(), &params).unwrap();
    let mut outcomes = (0..400).map(|step| {
        let shares = std::array::from_fn(|joint| 0.5 + 0.5 * (0.7 * (step * (joint + 1)) as f64).sin());
        let unstable = world.step(&bench::at_shares(&shares)).unstable;
        (unstable, world.data().warning().iter().any(|warning| warning.number > 0))
    });
    let (_, warned) = outcomes.find(|(unstable, _)| *unstable).expect("these keys swing up");
    assert!(warned, "MuJoCo has not started over");
    // The clock of a new episode begins at 0 as well, and that is none.
    world.set_params(&PhysicalParams::default());
    world.reset();
    let targets = world.start_pose();
    assert!((0..20).all(|_| !world.step(&targets).unstable));
}

proptest! {
    #![proptest_config(bench::cases(64))]

    #[test]
    fn every_controlled_world_is_stable(
        params in params(Actuation::Controlled),
        targets in targets(),
    ) {
        let config = StageConfig { actuation: Actuation::Controlled, ..StageConfig::default() };
        calm(&config, &params, &targets)?;
    }

    #[test]
    fn every_world_with_position_actuators_is_stable(
        params in params(Actuation::Position),
        targets in targets(),
    ) {
        let config = StageConfig { actuation: Actuation::Position, ..StageConfig::default() };
        calm(&config, &params, &targets)?;
    }
}
