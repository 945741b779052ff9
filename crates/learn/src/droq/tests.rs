//! The update against PyTorch (fixtures made by `scripts/golden_learn.py`), and the losses against finite differences.

use std::path::Path;

use safetensors::SafeTensors;

use super::{critic::CriticPasses, gaussian::Gaussian, *};
use crate::{config::Arithmetic, kernels::at_every_level, network::Wanted, tensors::find_tensors};

const ACTION: usize = 3;
const LAYOUT: ObservationLayout = ObservationLayout { real: 5, binary: 40 };
const UPDATES: usize = 5;

/// A fixture in memory.
struct Golden(Vec<u8>);

impl Golden {
    fn read(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
        Self(std::fs::read(folder.join(format!("{name}.safetensors"))).unwrap())
    }

    fn find(&self, name: &str) -> Option<(Vec<usize>, Vec<f32>)> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let view = file.tensor(name).ok()?;
        let values = view.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        Some((view.shape().to_vec(), values))
    }

    fn get(&self, name: &str) -> Vec<f32> {
        self.find(name).unwrap_or_else(|| panic!("{name} is not in the fixture")).1
    }

    fn batch_size(&self) -> usize {
        self.get("update0.reward").len()
    }

    /// Loads what `prefix` names, for example `before`, into a learner.
    fn load(&self, droq: &mut Droq, prefix: &str) {
        let lookup = |name: &str| self.find(&format!("{prefix}.{name}"));
        let plan = &droq.actor_network.plan;
        find_tensors(plan, "actor.parameters", &lookup, &mut droq.actor.parameters).unwrap();
        let plan = &droq.critic_network.plan;
        for (index, critic) in droq.critics.iter_mut().enumerate() {
            let parameters = &mut critic.learned.parameters;
            find_tensors(plan, &format!("critic{index}.parameters"), &lookup, parameters).unwrap();
            find_tensors(plan, &format!("critic{index}.target"), &lookup, &mut critic.target).unwrap();
        }
        droq.log_temperature.value = self.get(&format!("{prefix}.log_temperature"))[0];
    }

    /// Puts batch and draws of one update into a learner's shards.
    fn prepare(&self, droq: &mut Droq, update: usize) {
        let discount = droq.config.discount as f32;
        let mut start = 0;
        for shard in &mut droq.shards {
            let Shard { batch, draws, .. } = shard;
            let rows = start..start + draws.noise.len() / ACTION;
            start = rows.end;
            let get = |name: &str, width: usize| {
                self.get(&format!("update{update}.{name}"))[rows.start * width..rows.end * width].to_vec()
            };
            batch.clear();
            let observation = get("observation", LAYOUT.len());
            observation.chunks(LAYOUT.len()).for_each(|row| batch.observation.push(row));
            let observation = get("next_observation", LAYOUT.len());
            observation.chunks(LAYOUT.len()).for_each(|row| batch.next_observation.push(row));
            batch.action = get("action", ACTION);
            batch.reward = get("reward", 1);
            batch.discount = get("continues", 1).iter().map(|continues| discount * continues).collect();
            draws.next_noise = get("next_noise", ACTION);
            draws.noise = get("noise", ACTION);
            for (critic, drops) in draws.drops.iter_mut().enumerate() {
                let passes = [
                    ("target", &mut drops.target),
                    ("online", &mut drops.online),
                    ("actor", &mut drops.actor),
                ];
                for (pass, layers) in passes {
                    for ((layer, list), &width) in layers.iter_mut().enumerate().zip(&droq.config.hidden) {
                        let mask = get(&format!("mask.critic{critic}.{pass}.{layer}"), width);
                        *list = (0..mask.len() as u32).filter(|&at| mask[at as usize] == 0.0).collect();
                    }
                }
            }
        }
        assert_eq!(start, self.batch_size());
    }

    /// Compares all of a learner with what `prefix` names.
    fn compare(&self, droq: &Droq, prefix: &str, tolerance: f32) {
        let temperature = droq.temperature_tensor();
        let mut compared = 0;
        for tensor in droq.tensors(&temperature) {
            if let Some((_, expected)) = self.find(&format!("{prefix}.{}", tensor.name)) {
                compare(&tensor.name, tensor.values, &expected, tolerance);
                compared += 1;
            }
        }
        assert_eq!(compared, 8 + 4 * 14);
        compare("temperature", &temperature[..1], &self.get(&format!("{prefix}.log_temperature")), tolerance);
    }
}

fn compare(name: &str, ours: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(ours.len(), expected.len(), "{name}");
    for (index, (a, b)) in ours.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance * b.abs().max(1.0), "{name}[{index}]: {a}, not {b}");
    }
}

fn learner(dropout: f64, batch: usize) -> Droq {
    learner_in_shards(batch, dropout, batch)
}

fn learner_in_shards(shard_rows: usize, dropout: f64, batch: usize) -> Droq {
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

fn golden(name: &str, dropout: f64) {
    let golden = Golden::read(name);
    let batch = golden.batch_size();
    for (parallel, shard_rows) in [(false, batch), (true, batch), (false, batch / 3 + 1), (true, 1)] {
        let mut droq = learner_in_shards(shard_rows, dropout, batch);
        golden.load(&mut droq, "before");
        for update in 0..UPDATES {
            golden.prepare(&mut droq, update);
            let Losses { critic, actor, temperature, entropy, q_mean } = droq.update(None, parallel);
            let losses = [critic, actor, temperature, entropy, q_mean].map(|loss| loss as f32);
            compare("losses", &losses, &golden.get(&format!("update{update}.losses")), 1e-5);
            if update == 0 {
                let mut gradients = Vec::new();
                let plan = &droq.critic_network.plan;
                for (index, critic) in droq.critics.iter().enumerate() {
                    let prefix = format!("gradient.critic{index}");
                    crate::tensors::name_tensors(plan, &prefix, &critic.learned.gradient, &mut gradients);
                }
                let plan = &droq.actor_network.plan;
                crate::tensors::name_tensors(plan, "gradient.actor", &droq.actor.gradient, &mut gradients);
                for gradient in gradients {
                    compare(&gradient.name, gradient.values, &golden.get(&gradient.name), 2e-6);
                }
                golden.compare(&droq, "first", 1e-5);
            }
        }
        golden.compare(&droq, "last", 1e-5);
    }
}

#[test]
fn updates_match_pytorch() {
    at_every_level(|| golden("plain", 0.0));
}

#[test]
fn updates_with_given_dropout_masks_match_pytorch() {
    at_every_level(|| golden("dropout", 0.1));
}

/// Compares `gradient` with central differences of `loss` in random directions over all of `parameters`.
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
    let mut used = vec![false; network.plan.len];
    network.plan.tensors.iter().for_each(|tensor| used[tensor.range.clone()].fill(true));
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
        let wanted: Vec<f32> = (0..rows).map(|row| (row as f32).sin()).collect();
        let critic = &droq.critics[0];
        let mut gradient = network.parameters();
        CriticPasses::new(&network, &droq.config, rows).regress(
            critic,
            &inputs,
            &wanted,
            &drops,
            &mut gradient,
        );
        let mut parameters = critic.learned.parameters.to_vec();
        let mut workspace = network.workspace(rows, false, Arithmetic::F32);
        check_directions(&mut parameters, &gradient, &used(&network), |parameters| {
            let values = network.forward(parameters, &inputs, &drops.online, dropout, false, &mut workspace);
            let squares = values.iter().zip(&wanted).map(|(&q, &y)| f64::from(q - y).powi(2));
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
    let (temperature, bounds) = (0.3f32, config.log_std_bounds);
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
            loss -= passes.judge(critic, inputs, drops) / 2.0;
            action_error.iter_mut().zip(passes.action_error.iter()).for_each(|(sum, &error)| *sum += error);
        }
        loss += policy.log_prob.iter().map(|&l| f64::from(temperature) * f64::from(l)).sum::<f64>();
        let mut output_error = vec![0.0; rows * 2 * ACTION];
        policy.backward(&output, &noise, bounds, temperature / rows as f32, &action_error, &mut output_error);
        let mut gradient = vec![0.0; parameters.len()];
        let wanted = Wanted::Parameters(&mut gradient);
        actor_network.backward(parameters, inputs, &[], 0.0, &output_error, wanted, &mut workspace);
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
            terminal: false,
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
    let [first, second] = &learners;
    assert_eq!(first.updates(), 20);
    let (a, b) = (first.temperature_tensor(), second.temperature_tensor());
    for (a, b) in first.tensors(&a).iter().zip(second.tensors(&b)) {
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
        |arithmetic| DroqConfig { hidden: vec![64, 48, 32], batch: 64, arithmetic, ..DroqConfig::default() };
    let mut learners = [Arithmetic::F32, Arithmetic::Bf16].map(|a| Droq::new(&config(a), LAYOUT, ACTION, 3));
    let [exact, rounded] = &mut learners;
    let losses = [exact.learn(&replay, false), rounded.learn(&replay, false)];
    assert!((losses[0].critic - losses[1].critic).abs() < 0.01 * losses[0].critic, "{losses:?}");
    let gradients = |droq: &Droq| {
        let critics = droq.critics.iter().map(|critic| critic.learned.gradient.to_vec());
        critics.chain([droq.actor.gradient.to_vec()]).collect::<Vec<_>>()
    };
    for (exact, rounded) in gradients(exact).iter().zip(gradients(rounded)) {
        let length = exact.iter().map(|x| x * x).sum::<f32>().sqrt();
        let error = exact.iter().zip(rounded).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt();
        assert!(error < 0.01 * length, "{error} of {length}");
        let rounds = crate::kernels::Bf16Products::new(1, 16).is_some();
        assert!(error > 0.0 || !rounds, "nothing was rounded");
    }
}
