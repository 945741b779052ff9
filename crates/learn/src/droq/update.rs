//! One update.

use rayon::prelude::*;

use super::{
    CRITICS, Droq, Losses, Trainable,
    shard::{Shard, UpdateInputs},
};
use crate::{
    kernels::{AdamStep, adam, adam_polyak},
    replay::Replay,
};

impl Droq {
    /// Updates with batches from `replay`, or without it with those that are in the shards.
    pub(super) fn update(&mut self, replay: Option<&Replay>, parallel: bool) -> Losses {
        self.updates += 1;
        self.each_shard(parallel, |shard, update| {
            if let Some(replay) = replay {
                shard.draw(update.config, replay);
            }
            shard.fit_critics(update);
        });
        self.step_critics(parallel);
        self.each_shard(parallel, |shard, update| shard.fit_actor(update));
        self.step_actor();
        let mean =
            |sum: fn(&Shard) -> f64| self.shards.iter().map(sum).sum::<f64>() / self.config.batch as f64;
        let (critic, q_mean) = (mean(|s| s.sums.squares), mean(|s| s.sums.q));
        let (actor, entropy) = (mean(|s| s.sums.actor), mean(|s| s.sums.entropy));
        let critics = CRITICS as f64;
        let temperature = self.update_temperature(entropy);
        Losses { critic: critic / critics, actor, temperature, entropy, q_mean: q_mean / critics }
    }

    /// Calls `work` for every shard.
    fn each_shard(&mut self, parallel: bool, work: impl Fn(&mut Shard, &UpdateInputs<'_>) + Sync) {
        let update = UpdateInputs {
            config: &self.config,
            actor_network: &self.actor_network,
            actor: &self.actor.parameters,
            critics: &self.critics,
            temperature: self.log_temperature[0].exp(),
            parallel,
        };
        if parallel {
            self.shards.par_iter_mut().with_max_len(1).for_each(|shard| work(shard, &update));
        } else {
            self.shards.iter_mut().for_each(|shard| work(shard, &update));
        }
    }

    fn step_critics(&mut self, parallel: bool) {
        let Self { critics: [first, second], shards, config, updates, .. } = self;
        let gradients = |index: usize| shards.iter().map(move |shard| &shard.passes[index].gradient[..]);
        let mut first = || first.step(config, *updates, gradients(0));
        let mut second = || second.step(config, *updates, gradients(1));
        if parallel {
            rayon::join(first, second);
        } else {
            first();
            second();
        }
    }

    fn step_actor(&mut self) {
        self.actor.gather(self.shards.iter().map(|shard| &shard.actor_gradient[..]));
        let step = self.actor_step(self.config.actor_learning_rate);
        let Trainable { parameters, gradient, mean, square } = &mut self.actor;
        if self.config.policy_polyak < 1.0 {
            let polyak = self.config.policy_polyak as f32;
            adam_polyak(step, polyak, parameters, gradient, mean, square, &mut self.policy);
        } else {
            adam(step, parameters, gradient, mean, square);
            self.policy.copy_from_slice(parameters);
        }
    }

    /// The optimiser's step of the actor or the temperature. While they are held, the rate is 0 and
    /// only their moments change.
    fn actor_step(&self, rate: f64) -> AdamStep {
        AdamStep::new(if self.actor_held { 0.0 } else { rate }, self.updates)
    }

    /// Returns the temperature loss.
    pub(super) fn update_temperature(&mut self, entropy: f64) -> f64 {
        let target = self.config.target_entropy_per_action * self.action_len as f64;
        // With temperature = e^x, the loss is its own derivative with respect to x.
        let loss = f64::from(self.log_temperature[0].exp()) * (entropy - target);
        let step = self.actor_step(self.config.temperature_learning_rate);
        let [value, mean, square] = self.log_temperature.each_mut().map(std::slice::from_mut);
        adam(step, value, &[loss as f32], mean, square);
        loss
    }
}
