//! The losses against finite differences; averaging, shards, threads and bfloat16.

use super::{critic::CriticPasses, gaussian::Gaussian, *};
use crate::{config::Arithmetic, network::GradientOf};

pub(super) const ACTION: usize = 3;
pub(super) const LAYOUT: ObservationLayout = ObservationLayout { real: 5, binary: 40 };

pub(super) fn compare(name: &str, ours: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(ours.len(), expected.len(), "{name}");
    for (index, (a, b)) in ours.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance * b.abs().max(1.0), "{name}[{index}]: {a}, not {b}");
    }
}

pub(super) fn learner(dropout: f64, batch: usize) -> Droq {
    learner_in_shards(batch, dropout, batch)
}

pub(super) fn learner_in_shards(shard_rows: usize, dropout: f64, batch: usize) -> Droq {
    let config = DroqConfig {
        hidden: vec![20, 12, 16],
        dropout,
        batch,
        discount: 0.8,
        polyak: 0.05,
        actor_learning_rate: 3e-3,
        critic_learning_rate: 3e-3,
        temperature_learning_rate: 3e-3,
        log_std_bounds: [-1.5, 0.1],
        ..DroqConfig::default()
    };
    Droq::with_shards_of(shard_rows, &config, LAYOUT, ACTION, 0)
}

/// Compares `gradient` with central differences of `loss` in random directions over all of
/// `parameters`.
fn check_directions(
    parameters: &mut [f32],
    gradient: &[f32],
    used: &[bool],
    mut loss: impl FnMut(&[f32]) -> f64,
) {
    let mut stream = Stream::new(11, "directions");
    for _ in 0..12 {
        let mut direction = vec![0.0; parameters.len()];
        stream.fill_normal(&mut direction);
        direction.iter_mut().zip(used).filter(|(_, used)| !**used).for_each(|(value, _)| *value = 0.0);
        // Five points: the critics bend too much for three.
        let step = 5e-4f32;
        let original = parameters.to_vec();
        let mut at = |steps: f32| {
            for ((parameter, &start), &along) in parameters.iter_mut().zip(&original).zip(&direction) {
                *parameter = start + steps * step * along;
            }
            loss(parameters)
        };
        let numeric = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / f64::from(12.0 * step);
        parameters.copy_from_slice(&original);
        let exact: f64 = gradient.iter().zip(&direction).map(|(&g, &d)| f64::from(g) * f64::from(d)).sum();
        assert!(
            (numeric - exact).abs() < 4e-3 * exact.abs().max(0.25),
            "{numeric} numerically, {exact} by backward"
        );
    }
}

/// Parameters that belong to a tensor (the gaps between tensors have no gradient).
fn used(network: &Network) -> Vec<bool> {
    let mut used = vec![false; network.parameter_layout.len];
    network.parameter_layout.tensors.iter().for_each(|tensor| used[tensor.range.clone()].fill(true));
    used
}

fn random_inputs(rows: usize) -> crate::network::Inputs {
    let mut stream = Stream::new(3, "inputs");
    let mut inputs = crate::network::Inputs::new(LAYOUT, ACTION, rows);
    for _ in 0..rows {
        let mut row = vec![0.0; LAYOUT.len()];
        stream.fill_normal(&mut row[..LAYOUT.real]);
        (0..5).for_each(|_| row[LAYOUT.real + stream.below(LAYOUT.binary)] = 1.0);
        inputs.push(&row);
    }
    let mut action = vec![0.0; rows * ACTION];
    stream.fill_normal(&mut action);
    inputs.set_extra(&action);
    inputs
}

#[test]
fn critic_gradients_match_finite_differences() {
    for dropout in [0.0, 0.2] {
        let rows = 9;
        let mut droq = learner(dropout, rows);
        let network = droq.critic_network.clone();
        let Shard { draws, streams, .. } = &mut droq.shards[0];
        draws.fill(&droq.config, rows, streams);
        let drops = draws.drops[0].clone();
        let inputs = random_inputs(rows);
        let targets: Vec<f32> = (0..rows).map(|row| (row as f32).sin()).collect();
        let critic = &droq.critics[0];
        let mut passes = CriticPasses::new(&network, &droq.config, rows);
        passes.regress(critic, &inputs, &targets, &drops);
        let mut parameters = critic.trainable.parameters.to_vec();
        let mut workspace = network.workspace(rows, false, Arithmetic::F32);
        check_directions(&mut parameters, &passes.gradient, &used(&network), |parameters| {
            let values = network.forward(parameters, &inputs, &drops.online, dropout, false, &mut workspace);
            let squares = values.iter().zip(&targets).map(|(&q, &y)| f64::from(q - y).powi(2));
            squares.sum::<f64>() / (2 * rows) as f64
        });
    }
}

#[test]
fn actor_gradients_match_finite_differences_through_the_critics() {
    let rows = 9;
    let mut droq = learner(0.2, rows);
    let Droq { config, actor_network, critic_network, critics, actor, shards, .. } = &mut droq;
    let Shard { draws, streams, .. } = &mut shards[0];
    draws.fill(config, rows, streams);
    let (drops, noise) = (draws.drops.clone(), draws.noise.clone());
    let mut passes = CriticPasses::new(critic_network, config, rows);
    let (temperature, smoothness, bounds) = (0.3f32, 2.0f32, config.log_std_bounds);
    let next: Vec<f32> = (0..rows * ACTION).map(|at| (at as f32).cos()).collect();
    let mut inputs = random_inputs(rows);
    let mut loss = |parameters: &[f32], inputs: &mut crate::network::Inputs| {
        let mut workspace = actor_network.workspace(rows, true, Arithmetic::F32);
        let output = actor_network.forward(parameters, inputs, &[], 0.0, true, &mut workspace).to_vec();
        let mut policy = Gaussian::new(ACTION, rows);
        policy.sample(&output, &noise, bounds);
        inputs.set_extra(policy.actions(rows));
        let mut action_error = vec![0.0; rows * ACTION];
        let mut loss = 0.0;
        for (critic, drops) in critics.iter().zip(&drops) {
            loss -= passes.actor_loss(critic, inputs, drops) / 2.0;
            action_error.iter_mut().zip(passes.action_error.iter()).for_each(|(sum, &error)| *sum += error);
        }
        loss += policy.log_prob.iter().map(|&l| f64::from(temperature) * f64::from(l)).sum::<f64>();
        let mut output_error = vec![0.0; rows * 2 * ACTION];
        policy.backward(&output, &noise, bounds, temperature / rows as f32, &action_error, &mut output_error);
        let mut action = vec![0.0; rows * ACTION];
        policy.actions_without_noise(&output, &mut action);
        let squares = action.iter().zip(&next).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        loss += f64::from(smoothness) * squares / ACTION as f64;
        policy.backward_of_change(&output, &next, smoothness / rows as f32, &mut output_error);
        let mut gradient = vec![0.0; parameters.len()];
        let of = GradientOf::Parameters(&mut gradient);
        actor_network.backward(parameters, inputs, &[], 0.0, &output_error, of, &mut workspace);
        (loss / rows as f64, gradient)
    };
    let mut parameters = actor.parameters.to_vec();
    let (_, gradient) = loss(&parameters, &mut inputs);
    check_directions(&mut parameters, &gradient, &used(actor_network), |p| loss(p, &mut inputs).0);
}

#[test]
fn temperature_follows_the_entropy() {
    for (entropy, sign) in [(10.0, -1.0), (-10.0, 1.0)] {
        let mut droq = learner(0.0, 4);
        let before = droq.temperature();
        droq.updates = 1;
        droq.update_temperature(entropy);
        assert!((droq.temperature() - before) * sign > 0.0, "entropy {entropy} against a target of -1.5");
    }
}

fn some_replay() -> Replay {
    let mut replay = Replay::new(LAYOUT, ACTION, 50, 1);
    let mut stream = Stream::new(1, "test");
    for _ in 0..50 {
        let mut observation = vec![1.0; LAYOUT.len()];
        stream.fill_normal(&mut observation[..LAYOUT.real]);
        let transition = crate::replay::Transition {
            observation: &observation,
            action: &[0.1, -0.2, 0.3],
            reward: stream.uniform(),
            ends: false,
            next_observation: &observation,
        };
        replay.push(transition);
    }
    replay
}

#[test]
fn the_policy_is_the_average_of_the_actor() {
    let replay = some_replay();
    for polyak in [0.25, 1.0] {
        let mut droq = learner(0.1, 16);
        droq.config.policy_polyak = polyak;
        let mut average = droq.actor_parameters().to_vec();
        for _ in 0..10 {
            droq.learn(&replay, false);
            for (average, &actor) in average.iter_mut().zip(droq.actor_parameters()) {
                *average += polyak as f32 * (actor - *average);
            }
        }
        compare("policy", droq.policy_parameters(), &average, 1e-6);
        let moved = average.iter().zip(droq.actor_parameters()).any(|(a, b)| (a - b).abs() > 1e-4);
        assert_eq!(moved, polyak < 1.0);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_in_parallel_too() {
    let replay = some_replay();
    let mut learners = [learner_in_shards(5, 0.1, 16), learner_in_shards(5, 0.1, 16)];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for _ in 0..20 {
        let [first, second] = &mut learners;
        assert_eq!(first.learn(&replay, false), pool.install(|| second.learn(&replay, true)));
    }
    let [first, second] = &mut learners;
    assert_eq!(first.updates(), 20);
    for (a, b) in first.tensors().iter().zip(second.tensors()) {
        assert_eq!(a.values, b.values, "{}", a.name);
    }
}

#[test]
fn shards_draw_for_themselves_and_continue_in_their_order() {
    let replay = some_replay();
    let mut droq = learner_in_shards(4, 0.3, 12);
    droq.config.n_step = 3;
    droq.learn(&replay, false);
    let [first, second, third] = &droq.shards[..] else { panic!("three shards") };
    for (a, b) in [(first, second), (second, third), (first, third)] {
        assert_ne!(a.batch.reward, b.batch.reward);
        assert_ne!(a.draws.noise, b.draws.noise);
        assert_ne!(a.draws.drops[0].online, b.draws.drops[0].online);
    }
    // Three rewards of up to 1, discounted by 0.8, except near the end of the replay.
    assert!(first.batch.discount.iter().any(|discount| (discount - 0.512).abs() < 1e-6));

    let mut other = learner_in_shards(4, 0.3, 12);
    assert!(other.restore_counters(droq.updates(), droq.streams()));
    droq.learn(&replay, false);
    other.config.n_step = 3;
    other.learn(&replay, false);
    for (a, b) in droq.shards.iter().zip(&other.shards) {
        assert_eq!(a.batch.reward, b.batch.reward);
        assert_eq!(a.draws.noise, b.draws.noise);
    }
    assert!(!learner_in_shards(6, 0.3, 12).restore_counters(1, droq.streams()));
}

#[test]
fn bfloat16_gradients_are_those_of_single_precision_up_to_rounding() {
    let replay = some_replay();
    let config =
        |arithmetic| DroqConfig { hidden: vec![64, 96, 32], batch: 64, arithmetic, ..DroqConfig::default() };
    let mut learners = [Arithmetic::F32, Arithmetic::Bf16].map(|a| Droq::new(&config(a), LAYOUT, ACTION, 3));
    let [exact, rounded] = &mut learners;
    let losses = [exact.learn(&replay, false), rounded.learn(&replay, false)];
    assert!((losses[0].critic - losses[1].critic).abs() < 0.01 * losses[0].critic, "{losses:?}");
    let gradients = |droq: &Droq| {
        let critics = droq.critics.iter().map(|critic| critic.trainable.gradient.to_vec());
        critics.chain([droq.actor.gradient.to_vec()]).collect::<Vec<_>>()
    };
    let rounds = crate::kernels::products_or_skip(32, 32).is_some();
    for (exact, rounded) in gradients(exact).iter().zip(gradients(rounded)) {
        let length = exact.iter().map(|x| x * x).sum::<f32>().sqrt();
        let error = exact.iter().zip(rounded).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt();
        assert!(error < 0.01 * length, "{error} of {length}");
        assert!(error > 0.0 || !rounds, "nothing was rounded");
    }
}
