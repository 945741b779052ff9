//! Updates against PyTorch, with fixtures made by `scripts/golden_learn.py`.

use std::path::Path;

use safetensors::SafeTensors;

use super::{
    tests::{ACTION, LAYOUT, compare, learner_in_shards},
    *,
};
use crate::{kernels::at_every_level, tensors::find_tensors};

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
        let layout = &droq.actor_network.parameter_layout;
        find_tensors(layout, "actor.parameters", &lookup, &mut droq.actor.parameters).unwrap();
        let layout = &droq.critic_network.parameter_layout;
        for (index, critic) in droq.critics.iter_mut().enumerate() {
            let parameters = &mut critic.trainable.parameters;
            find_tensors(layout, &format!("critic{index}.parameters"), &lookup, parameters).unwrap();
            find_tensors(layout, &format!("critic{index}.target"), &lookup, &mut critic.target).unwrap();
        }
        droq.log_temperature[0] = self.get(&format!("{prefix}.log_temperature"))[0];
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
    fn compare(&self, droq: &mut Droq, prefix: &str, tolerance: f32) {
        let mut compared = 0;
        for tensor in droq.tensors() {
            if let Some((_, expected)) = self.find(&format!("{prefix}.{}", tensor.name)) {
                compare(&tensor.name, tensor.values, &expected, tolerance);
                compared += 1;
            }
        }
        assert_eq!(compared, 8 + 4 * 14);
        compare(
            "temperature",
            &droq.log_temperature[..1],
            &self.get(&format!("{prefix}.log_temperature")),
            tolerance,
        );
    }
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
                let layout = &droq.critic_network.parameter_layout;
                for (index, critic) in droq.critics.iter().enumerate() {
                    let prefix = format!("gradient.critic{index}");
                    crate::tensors::name_tensors(layout, &prefix, &critic.trainable.gradient, &mut gradients);
                }
                let layout = &droq.actor_network.parameter_layout;
                crate::tensors::name_tensors(layout, "gradient.actor", &droq.actor.gradient, &mut gradients);
                for gradient in gradients {
                    compare(&gradient.name, gradient.values, &golden.get(&gradient.name), 2e-6);
                }
                golden.compare(&mut droq, "first", 1e-5);
            }
        }
        golden.compare(&mut droq, "last", 1e-5);
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
