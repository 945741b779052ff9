//! No parameter within its range and no target may upset the engine: a NaN or a silent restart in the middle of a
//! training costs days.

use etude_stage::{Actuation, JOINTS, PhysicalParams, StageConfig, World};
use proptest::prelude::*;

use crate::bench;

/// Any numbers within the rows' ranges, small and large alike where a row spans decades; a share of exactly 0 or 1
/// stands for the end of the range.
fn params() -> impl Strategy<Value = PhysicalParams> {
    let share = prop_oneof![1 => Just(0.0), 1 => Just(1.0), 4 => 0.0f64..1.0];
    prop::collection::vec(share, PhysicalParams::rows().count()).prop_map(|shares| {
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
        params
    })
}

fn targets() -> impl Strategy<Value = Vec<[f64; JOINTS]>> {
    prop::collection::vec((prop::array::uniform13(0.0f64..1.0), 1usize..5), 5..12).prop_map(|moves| {
        moves.iter().flat_map(|(shares, steps)| vec![bench::at_shares(shares); *steps]).collect()
    })
}

fn calm(
    config: &StageConfig,
    params: &PhysicalParams,
    targets: &[[f64; JOINTS]],
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
        for event in world.events() {
            prop_assert!(
                (1.0..128.0).contains(&(f64::from(event.velocity.max(1)))) && event.secs.is_finite()
            );
        }
    }
    Ok(())
}

/// Sets a number of every finger joint, at `share` of the way (in decades) between the two.
fn narrow(params: &mut PhysicalParams, name: &str, [low, high]: [f64; 2], share: f64) {
    params.set(&format!("joint.fingers.{name}"), low * (high / low).powf(share)).unwrap();
}

/// What the engine bears of a finger, with every other number anywhere in its range. Found with this test: beyond, one
/// physics step of full torque throws a joint so far that MuJoCo starts over. The rows' ranges are wider, because the
/// rail needs them.
const TORQUE_LIMIT: [f64; 2] = [0.01, 2.0];
/// The same for position actuators, which have no torque limit: N·m/rad, N·m·s/rad, kg·m².
const POSITION: [(&str, [f64; 2]); 3] =
    [("stiffness", [0.1, 20.0]), ("damping", [0.001, 1.0]), ("armature", [1e-3, 50.0])];

proptest! {
    #![proptest_config(bench::cases(1500))]

    #[test]
    fn no_controlled_world_upsets_the_engine(
        mut params in params(),
        share in 0.0f64..1.0,
        targets in targets(),
    ) {
        narrow(&mut params, "torque_limit", TORQUE_LIMIT, share);
        let config = StageConfig { actuation: Actuation::Controlled, ..StageConfig::default() };
        calm(&config, &params, &targets)?;
    }

    #[test]
    fn no_world_with_position_actuators_upsets_the_engine(
        mut params in params(),
        shares in prop::array::uniform3(0.0f64..1.0),
        targets in targets(),
    ) {
        for ((name, range), share) in POSITION.into_iter().zip(shares) {
            narrow(&mut params, name, range, share);
        }
        let config = StageConfig { actuation: Actuation::Position, ..StageConfig::default() };
        calm(&config, &params, &targets)?;
    }
}
