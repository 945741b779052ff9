//! No parameter within its range and no target may upset the engine.

use std::collections::BTreeMap;

use etude_stage::{JOINTS, PhysicalParams, StageConfig, World};
use proptest::prelude::*;

use crate::bench;

/// How often MuJoCo complained or started over since the last reset.
pub fn warnings(world: &World) -> i32 {
    world.data().warning().iter().map(|warning| warning.number).sum()
}

fn upset(config: &StageConfig, params: &PhysicalParams, targets: &[[f64; JOINTS]]) -> Option<String> {
    let mut world = World::new(config, params).unwrap();
    for (step, targets) in targets.iter().enumerate() {
        world.step(targets);
        if warnings(&world) > 0 {
            let kinds: Vec<i32> = world.data().warning().iter().map(|w| w.number).collect();
            return Some(format!("MuJoCo warns in step {step}: {kinds:?}"));
        }
        if !world.data().qpos().iter().chain(world.data().qvel()).all(|v| v.is_finite()) {
            return Some(format!("not finite in step {step}"));
        }
        let fastest = world.data().qvel().iter().fold(0.0f64, |most, v| most.max(v.abs()));
        if fastest > 1e4 {
            return Some(format!("{fastest:.1e} rad/s in step {step}"));
        }
    }
    None
}

#[test]
fn study() {
    use etude_stage::Actuation;
    let mut seed = 1u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as f64 / (1u64 << 31) as f64
    };
    let targets: Vec<[f64; JOINTS]> = (0..40).flat_map(|_| [bench::at_shares(&std::array::from_fn(|_| random())); 4]).collect();
    for actuation in [Actuation::Controlled, Actuation::Position] {
        let config = StageConfig { actuation, ..StageConfig::default() };
        println!("nominal {actuation:?}: {:?}", upset(&config, &PhysicalParams::default(), &targets));
        let mut bad: BTreeMap<String, String> = BTreeMap::new();
        for (path, row, default) in PhysicalParams::rows() {
            for (end, value) in [("low", row.range[0]), ("high", row.range[1])] {
                let mut params = PhysicalParams::default();
                params.set(&path, value).unwrap();
                if let Some(why) = upset(&config, &params, &targets) {
                    // Halve the way (geometrically where possible) back to the default until it is calm.
                    let mut calm = default;
                    let mut wild = value;
                    for _ in 0..12 {
                        let middle = if calm > 0.0 && wild > 0.0 { (calm * wild).sqrt() } else { (calm + wild) / 2.0 };
                        params.set(&path, middle).unwrap();
                        if upset(&config, &params, &targets).is_some() { wild = middle } else { calm = middle }
                    }
                    bad.insert(format!("{path} {end}"), format!("{value}: {why}; calm to {calm:.4}"));
                }
            }
        }
        println!("{actuation:?} {bad:#?}");
    }
}

proptest! {
    #![proptest_config(bench::cases(8))]
    #[test]
    fn dummy(_x in 0..1) {}
}
