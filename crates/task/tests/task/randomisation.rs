//! Randomised worlds: another one for each episode, the same ones for the same seed, the nominal
//! one at intensity 0, and none in which the simulation is unstable.

use std::collections::BTreeMap;

use etude_stage::{Actuation, PhysicalParams, World, joint_range};
use etude_task::{Environment, Randomisation, RandomisationConfig, TaskConfig, Widths};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::bench::{nominal, restless, short_piece};

fn worlds(config: &TaskConfig, seed: u64, episodes: usize) -> Vec<PhysicalParams> {
    let mut environment = Environment::new(config, &short_piece(), seed).unwrap();
    (0..episodes)
        .map(|_| {
            environment.reset();
            environment.world().params().clone()
        })
        .collect()
}

#[test]
fn every_episode_has_its_own_world_and_every_seed_its_own_episodes() {
    let drawn = worlds(&restless(), 1, 20);
    for (index, world) in drawn.iter().enumerate() {
        assert!(drawn[..index].iter().all(|other| other != world), "episode {index} repeats a world");
    }
    assert_eq!(worlds(&restless(), 1, 20), drawn);
    assert_ne!(worlds(&restless(), 2, 20), drawn);
}

#[test]
fn intensity_zero_is_the_nominal_world() {
    let mut config = nominal();
    config.physics.insert("key.stiffness".into(), 1.7);
    assert!(worlds(&config, 1, 5).iter().all(|world| *world == config.params().unwrap()));
}

/// An episode in a drawn world is the one of an environment whose nominal world is the drawn one.
#[test]
fn a_drawn_world_is_in_force_from_the_first_step() {
    let config = restless();
    let piece = short_piece();
    let mut drawn = Environment::new(&config, &piece, 3).unwrap();
    drawn.reset();
    let mut fixed = nominal();
    for (path, _, _) in PhysicalParams::rows() {
        fixed.physics.insert(path.clone(), drawn.world().params().get(&path).unwrap());
    }
    let mut built = Environment::new(&fixed, &piece, 0).unwrap();
    let mut parts = [0.0; 5];
    let press = [0.0, 0.3, 0.2, 0.1, 0.0, 0.4, 0.2, 0.1, 0.0, 0.3, 0.2, 0.1, 0.05];
    for _ in 0..piece.steps() {
        assert_eq!(drawn.step(&press, &mut parts), built.step(&press, &mut parts));
        assert_eq!(drawn.world().joints(), built.world().joints());
        assert_eq!(drawn.world().pressed(), built.world().pressed());
    }
}

/// Steps `world` under random targets all over the joints' ranges, which change every other control
/// step.
fn calm(world: &mut World, random: &mut Pcg64) -> Result<(), String> {
    let mut targets = world.start_pose();
    for step in 0..16 {
        if step % 2 == 0 {
            targets = std::array::from_fn(|joint| {
                let [low, high] = joint_range(joint);
                random.random_range(low..=high)
            });
        }
        let outcome = world.step(&targets);
        let warnings: i32 = world.data().warning().iter().map(|warning| warning.number).sum();
        if warnings > 0 {
            return Err(format!("{warnings} warnings of the engine in step {step}"));
        }
        let numbers = world.data().qpos().iter().chain(world.data().qvel()).chain(world.torques());
        if !numbers.copied().all(f64::is_finite) || !outcome.finger_power.is_finite() {
            return Err(format!("a number that is not finite in step {step}"));
        }
        for (joint, position) in world.joints().iter().enumerate() {
            let [low, high] = joint_range(joint);
            // Stops are soft, and position actuators throw the hand against them with torques
            // without limit.
            let beyond = if world.config().actuation == Actuation::Position { 10.0 } else { high - low };
            if !(low - beyond..=high + beyond).contains(position) {
                return Err(format!("joint {joint} at {position} in step {step}"));
            }
        }
    }
    Ok(())
}

#[test]
fn worlds_of_full_intensity_stay_calm_under_random_actions() {
    let mut random = Pcg64::seed_from_u64(8);
    // As identified robots may be: stiffer and more damped than the defaults, with delays, dry
    // friction and an arm's limits.
    let mut other = nominal();
    for (path, value) in [
        ("joint.fingers.stiffness", 6.0),
        ("joint.fingers.damping", 0.2),
        ("joint.fingers.friction", 0.05),
        ("joint.all.delay", 0.02),
        ("joint.rail.acceleration_limit", 7.5),
        ("joint.rail.stiffness", 40_000.0),
        ("joint.rail.damping", 2_000.0),
    ] {
        other.physics.insert(path.into(), value);
    }
    let wide: BTreeMap<String, f64> = PhysicalParams::rows()
        .map(|(path, row, _)| (path, 0.5 * (row.range[1] - row.range[0])))
        .filter(|(path, _)| !path.starts_with("keyboard."))
        .collect();
    let full = |widths| RandomisationConfig { intensity: 1.0, widths };
    for (name, config, widths, worlds) in [
        ("paper", nominal(), Widths::default(), 300),
        ("paper about another robot", other.clone(), Widths::default(), 100),
        ("half of every row", nominal(), Widths::Identified(wide), 100),
    ] {
        for actuation in [Actuation::Controlled, Actuation::Position] {
            let mut config = config.clone();
            config.stage.actuation = actuation;
            let randomisation =
                Randomisation::new(config.params().unwrap(), &full(widths.clone()), actuation).unwrap();
            let mut world = World::new(&config.stage, &config.params().unwrap()).unwrap();
            for index in 0..worlds {
                let params = randomisation.draw(&mut random);
                world.set_params(&params);
                world.reset();
                if let Err(why) = calm(&mut world, &mut random) {
                    panic!("world {index} of `{name}`, {actuation:?}: {why}: {params:?}");
                }
            }
        }
    }
}
