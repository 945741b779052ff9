//! The promises of `VectorEnvironment`: the same bytes on any number of threads, and episodes that
//! start over by themselves.

use etude_learn::{StepBatch, VectorEnvironment as _};
use etude_task::{Environment, PianoVectorEnv, TaskConfig};

use crate::bench::{Actions, batch, nominal, play, restless, short_piece};

const ENVS: usize = 5;

fn on_threads(threads: usize, config: &TaskConfig) -> (Vec<f32>, Vec<StepBatch>, Vec<u8>) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let mut piano = PianoVectorEnv::new(config, &short_piece(), ENVS, 11).unwrap();
        let mut first = batch(&piano).observation;
        piano.reset(&mut first);
        let batches = play(&mut piano, &mut Actions::new(ENVS, 1), 70);
        (first, batches, piano.save_state())
    })
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    for config in [nominal(), restless()] {
        let one = on_threads(1, &config);
        assert!(one.1.iter().any(|batch| batch.truncated.contains(&true)), "episodes end within the test");
        for threads in [2, 3] {
            assert!(on_threads(threads, &config) == one, "{threads} threads differ from one");
        }
    }
}

#[test]
fn environments_and_seeds_differ_where_worlds_are_random_and_not_where_they_are_not() {
    let first = |config: &TaskConfig, seed| {
        let mut piano = PianoVectorEnv::new(config, &short_piece(), 2, seed).unwrap();
        let mut observation = batch(&piano).observation;
        piano.reset(&mut observation);
        let half = observation.len() / 2;
        (observation[..half].to_vec(), observation[half..].to_vec())
    };
    let (a, b) = first(&restless(), 1);
    assert_ne!(a, b);
    assert_ne!(first(&restless(), 2).0, a);
    let (a, b) = first(&nominal(), 1);
    assert_eq!(a, b);
    assert_eq!(first(&nominal(), 2).0, a);
}

#[test]
fn episodes_start_over_at_the_songs_end() {
    let piece = short_piece();
    let config = nominal();
    let mut piano = PianoVectorEnv::new(&config, &piece, 2, 3).unwrap();
    let mut first = batch(&piano).observation;
    piano.reset(&mut first);
    let batches = play(&mut piano, &mut Actions::new(2, 4), 2 * piece.steps() + 3);
    // The same by hand, environment by environment.
    let mut actions = Actions::new(2, 4);
    let len = piano.layout().len();
    let mut alone: Vec<Environment> = (0..2).map(|_| Environment::new(&config, &piece, 0).unwrap()).collect();
    let mut parts = vec![0.0; alone[0].reward().names().len()];
    for (index, batch) in batches.iter().enumerate() {
        let over = (index + 1) % piece.steps() == 0;
        assert_eq!(batch.truncated, [over; 2], "step {index}");
        let actions = actions.next().to_vec();
        for (env, environment) in alone.iter_mut().enumerate() {
            let action = actions[env * 13..].first_chunk().unwrap();
            let step = environment.step(action, &mut parts);
            let mut observation = vec![0.0; len];
            environment.observe(&mut observation);
            assert_eq!(batch.next_observation[env * len..][..len], observation, "what the step led to");
            assert_eq!(batch.reward[env], step.reward as f32);
            assert_eq!(batch.reward_terms[env * parts.len()..][..parts.len()], parts);
            assert!((parts.iter().sum::<f32>() - batch.reward[env]).abs() < 1e-5);
            if over {
                assert_ne!(observation, first[..len], "the end of the song is not its beginning");
                environment.reset();
                environment.observe(&mut observation);
                assert_eq!(observation, first[..len], "without randomness every episode starts alike");
            }
            assert_eq!(batch.observation[env * len..][..len], observation, "what to act on next");
        }
    }
}

#[test]
fn the_binary_columns_are_exactly_binary() {
    let mut piano = PianoVectorEnv::new(&restless(), &short_piece(), 3, 5).unwrap();
    let layout = piano.layout();
    let mut ones = 0;
    for batch in play(&mut piano, &mut Actions::new(3, 6), 60) {
        for observation in batch.next_observation.chunks_exact(layout.len()) {
            let (real, binary) = observation.split_at(layout.real);
            assert!(real.iter().all(|value| value.is_finite() && value.abs() < 20.0));
            assert!(binary.iter().all(|value| *value == 0.0 || *value == 1.0));
            ones += binary.iter().filter(|value| **value == 1.0).count();
        }
    }
    assert!(ones > 0);
}

/// A reward without terms is odd but allowed, for instance while everything is tried one by one;
/// the worlds still move.
#[test]
fn environments_step_without_any_reward_term() {
    let mut config = nominal();
    for term in etude_task::reward::TERMS {
        config.reward.insert(term.name.to_string(), 0.0);
    }
    let mut piano = PianoVectorEnv::new(&config, &short_piece(), 2, 0).unwrap();
    let batches = play(&mut piano, &mut Actions::new(2, 1), 3);
    assert_ne!(batches[0].observation, batches[2].observation);
}

#[test]
fn a_world_that_bursts_earns_what_no_learner_takes() {
    let mut config = nominal();
    for (path, value) in [("key.stiffness", 5.0), ("key.armature", 1e-5), ("key.damping", 0.001)] {
        config.physics.insert(path.to_string(), value);
    }
    let earned = |config: &TaskConfig| {
        let mut piano = PianoVectorEnv::new(config, &short_piece(), 2, 0).unwrap();
        play(&mut piano, &mut Actions::new(2, 1), 200)
            .iter()
            .flat_map(|batch| batch.reward.clone())
            .collect::<Vec<f32>>()
    };
    assert!(earned(&nominal()).iter().all(|reward| reward.is_finite()));
    assert!(earned(&config).iter().any(|reward| reward.is_nan()));
}
