//! Randomised worlds: another one for each episode, the same ones for the same seed, the nominal one at intensity 0.

use etude_stage::{JOINTS, PhysicalParams, RAIL};
use etude_task::{Environment, RandomisationConfig, TaskConfig};

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
    let config = TaskConfig { random_start: false, ..restless() };
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
        assert_eq!(drawn.pressed(), built.pressed());
    }
}

#[test]
fn random_starts_cover_the_song_with_a_finger_over_the_next_key() {
    let config = TaskConfig { randomisation: RandomisationConfig::default(), ..restless() };
    let piece = short_piece();
    let mut environment = Environment::new(&config, &piece, 4).unwrap();
    let mut seen = vec![false; piece.steps()];
    for _ in 0..400 {
        environment.reset();
        seen[environment.position()] = true;
        let due = piece.frames()[environment.position()..].iter().find(|due| !due.is_empty());
        if let Some(key) = due.and_then(|due| due.iter().next())
            && environment.position() > 0
        {
            let at = environment.world().key_target(key)[1];
            let nearest = (0..3)
                .map(|f| (environment.world().fingertip(f)[1] - at).abs())
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-3, "{nearest} m off key {key}");
        }
    }
    assert!(seen.iter().all(|seen| *seen), "every place of the song is a start");
}

/// An identified robot has encoder biases; a random start must not bend the fingers by them.
#[test]
fn a_random_start_with_biased_encoders_holds_the_true_pose() {
    let mut config = TaskConfig { randomisation: RandomisationConfig::default(), ..restless() };
    let piece = short_piece();
    let honest = Environment::new(&nominal(), &piece, 0).unwrap().world().joints();
    config.physics.insert("joint.fingers.encoder_bias".into(), 0.04);
    config.physics.insert("joint.rail.encoder_bias".into(), 0.02);
    let mut environment = Environment::new(&config, &piece, 4).unwrap();
    for _ in 0..20 {
        environment.reset();
        let readings = environment.world().joints();
        for joint in (0..JOINTS).filter(|joint| *joint != RAIL) {
            let off = readings[joint] - honest[joint] - 0.04;
            assert!(off.abs() < 1e-9, "joint {joint} starts {off} rad off");
        }
    }
}
