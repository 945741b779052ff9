//! The algorithm: soft actor-critic with two dropout critics (Hiraoka et al. 2022, arXiv
//! 2110.02034) in the form that the RoboPianist line uses: one update a step, and the mean of the
//! critics in the actor's loss.
//!
//! One update is, in this order: the critics towards `reward + discount · (min target Q -
//! temperature · log π)`, the target critics towards the critics, the actor along `temperature ·
//! log π - mean Q`, and the temperature towards the target entropy. Dropout is active in all passes
//! of critics and target critics. With `n_step` above 1 the reward is the discounted sum over
//! several steps, and the target that of the last; the entropy of the steps in between is left out.

mod critic;
mod draws;
mod gaussian;
mod shard;
mod tensors;
mod trainable;
mod update;

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod tests;

pub(crate) use draws::{CRITICS, ShardStreams};
pub(crate) use gaussian::Gaussian;
pub(crate) use trainable::Trainable;

use crate::{
    buffer::Buffer,
    config::DroqConfig,
    env::ObservationLayout,
    network::{Network, Shape},
    random::Stream,
    replay::Replay,
};
use critic::Critic;
use shard::Shard;

/// Losses of one update.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Losses {
    /// Mean over rows and critics of `(Q - target)²`.
    pub critic: f64,
    /// Mean over rows of `temperature · log π - mean Q`.
    pub actor: f64,
    /// `temperature · (entropy - target entropy)`.
    pub temperature: f64,
    /// Mean over rows of `-log π`, in nats.
    pub entropy: f64,
    /// Mean over rows and critics of Q at the actions taken.
    pub q_mean: f64,
}

/// The actor, the critics and the temperature, with all buffers of an update.
pub(crate) struct Droq {
    config: DroqConfig,
    action_len: usize,
    actor_network: Network,
    critic_network: Network,
    actor: Trainable,
    /// Average of the actor over its updates, which is evaluated and saved.
    policy: Buffer,
    critics: [Critic; CRITICS],
    /// Logarithm of the temperature, and its two Adam moments.
    log_temperature: [f32; 3],
    /// Number of updates, which is also Adam's step count.
    updates: u64,
    /// Whether updates do not change the actor and the temperature.
    actor_held: bool,
    /// The batch in parts that threads share.
    shards: Vec<Shard>,
}

/// The shape of the actor's network.
pub(crate) fn actor_shape(layout: ObservationLayout, action_len: usize, hidden: &[usize]) -> Shape {
    Shape { layout, extra: 0, hidden: hidden.to_vec(), outputs: 2 * action_len, normalised: false }
}

/// The shape of a critic's network.
fn critic_shape(layout: ObservationLayout, action_len: usize, hidden: &[usize]) -> Shape {
    Shape { layout, extra: action_len, hidden: hidden.to_vec(), outputs: 1, normalised: true }
}

impl Droq {
    /// Fresh networks. `config` must be valid.
    pub(crate) fn new(config: &DroqConfig, layout: ObservationLayout, action_len: usize, seed: u64) -> Self {
        let rows = shard::ROWS.max(config.batch.div_ceil(shard::MAX_SHARDS));
        Self::with_shards_of(rows, config, layout, action_len, seed)
    }

    /// The same with at most `shard_rows` rows a shard.
    fn with_shards_of(
        shard_rows: usize,
        config: &DroqConfig,
        layout: ObservationLayout,
        action_len: usize,
        seed: u64,
    ) -> Self {
        let actor_network = Network::new(actor_shape(layout, action_len, &config.hidden));
        let critic_network = Network::new(critic_shape(layout, action_len, &config.hidden));
        let actor = actor_network.initialise(&mut Stream::new(seed, "init/actor"));
        let critics = ["init/critic-0", "init/critic-1"].map(|purpose| {
            Critic::new(&critic_network, critic_network.initialise(&mut Stream::new(seed, purpose)))
        });
        let shards = (0..config.batch.div_ceil(shard_rows))
            .map(|index| {
                let rows = shard_rows.min(config.batch - index * shard_rows);
                let streams = ShardStreams::new(seed, index);
                Shard::new(config, &actor_network, &critic_network, streams, rows)
            })
            .collect();
        Self {
            config: config.clone(),
            action_len,
            policy: actor.clone(),
            actor: Trainable::new(&actor_network, actor),
            actor_network,
            critic_network,
            critics,
            log_temperature: [config.initial_temperature.ln() as f32, 0.0, 0.0],
            updates: 0,
            actor_held: false,
            shards,
        }
    }

    /// One update on a batch from `replay`, which must not be empty. With `parallel`, the shards
    /// may run on the threads of the current rayon pool; the result has the same bytes.
    pub(crate) fn learn(&mut self, replay: &Replay, parallel: bool) -> Losses {
        self.update(Some(replay), parallel)
    }

    pub(crate) fn actor_network(&self) -> &Network {
        &self.actor_network
    }

    pub(crate) fn actor_parameters(&self) -> &[f32] {
        &self.actor.parameters
    }

    /// Parameters that are evaluated and saved. Exploration uses
    /// [`actor_parameters`](Self::actor_parameters).
    pub(crate) fn policy_parameters(&self) -> &[f32] {
        &self.policy
    }

    /// Whether updates from now on do not change the actor and the temperature, except their
    /// optimiser moments.
    pub(crate) fn hold_actor(&mut self, held: bool) {
        self.actor_held = held;
    }

    pub(crate) fn updates(&self) -> u64 {
        self.updates
    }

    pub(crate) fn temperature(&self) -> f64 {
        f64::from(self.log_temperature[0]).exp()
    }

    /// The generators of the shards.
    pub(crate) fn streams(&self) -> Vec<ShardStreams> {
        self.shards.iter().map(|shard| shard.streams.clone()).collect()
    }

    /// Continues with the draws and the count of a saved learner; `false` when it had another
    /// number of shards.
    pub(crate) fn restore_counters(&mut self, updates: u64, streams: Vec<ShardStreams>) -> bool {
        self.updates = updates;
        let fits = streams.len() == self.shards.len();
        for (shard, streams) in self.shards.iter_mut().zip(streams) {
            shard.streams = streams;
        }
        fits
    }
}
