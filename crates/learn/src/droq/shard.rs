//! A part of the batch, which one thread processes.
//!
//! The parameters do not change while shards are processed. Each shard computes its part of each gradient; the parts are added up in
//! the order of the shards, so the bytes do not depend on the threads.

use super::{
    critic::{Critic, CriticPasses},
    draws::{CRITICS, Draws, ShardStreams},
    gaussian::Gaussian,
};
use crate::{
    buffer::Buffer,
    config::DroqConfig,
    kernels::add_row,
    network::{Network, Wanted, Workspace},
    replay::{Batch, Horizon, Replay},
};

/// Rows of a shard: two threads share a batch of 256. With shards of 64 an update is 10 % slower, since every product packs its weights
/// twice as often.
pub(super) const ROWS: usize = 128;
/// The most shards of a batch; each has buffers for all gradients.
pub(super) const MOST: usize = 16;

/// What the shards of an update read.
pub(super) struct View<'a> {
    pub config: &'a DroqConfig,
    pub actor_network: &'a Network,
    /// The actor's parameters.
    pub actor: &'a [f32],
    pub critics: &'a [Critic; CRITICS],
    pub temperature: f32,
}

/// Sums over a shard's rows.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    /// `(Q - wanted)²` and Q, over both critics.
    pub squares: f64,
    pub q: f64,
    /// `temperature · log π - mean Q` and `-log π`.
    pub actor: f64,
    pub entropy: f64,
}

pub(super) struct Shard {
    pub streams: ShardStreams,
    pub batch: Batch,
    pub draws: Draws,
    pub sums: Sums,
    pub actor_gradient: Buffer,
    pub critic_gradients: [Buffer; CRITICS],
    actor: Workspace,
    critic: CriticPasses,
    policy: Gaussian,
    /// `[rows, action]`: the policy's actions in the next observations, without exploration.
    next_action: Vec<f32>,
    /// `[rows]`: target values of the critics.
    wanted: Vec<f32>,
    /// `[rows, 2 · action]`
    output_error: Vec<f32>,
    /// `[rows, action]`
    action_error: Vec<f32>,
}

impl Shard {
    pub(super) fn new(
        config: &DroqConfig,
        actor_network: &Network,
        critic_network: &Network,
        streams: ShardStreams,
        rows: usize,
    ) -> Self {
        let (layout, action_len) = (critic_network.shape.layout, critic_network.shape.extra);
        Self {
            streams,
            batch: Batch::new(layout, action_len, rows),
            draws: Draws::new(config, rows, action_len),
            sums: Sums::default(),
            actor_gradient: actor_network.parameters(),
            critic_gradients: [critic_network.parameters(), critic_network.parameters()],
            actor: actor_network.workspace(rows, true, config.arithmetic),
            critic: CriticPasses::new(critic_network, config, rows),
            policy: Gaussian::new(action_len, rows),
            next_action: vec![0.0; rows * action_len],
            wanted: vec![0.0; rows],
            output_error: vec![0.0; rows * 2 * action_len],
            action_error: vec![0.0; rows * action_len],
        }
    }

    /// Draws the rows and all other random numbers of the next update.
    pub(super) fn draw(&mut self, config: &DroqConfig, replay: &Replay) {
        let (rows, horizon) =
            (self.wanted.len(), Horizon { steps: config.n_step, discount: config.discount });
        replay.sample(&mut self.streams.replay, rows, horizon, &mut self.batch);
        self.draws.fill(config, rows, &mut self.streams);
    }

    /// Computes the gradients of the critics.
    pub(super) fn fit_critics(&mut self, view: &View<'_>) {
        let Self { batch, draws, actor, critic: passes, policy, next_action, wanted, .. } = self;
        let output = view.actor_network.forward(view.actor, &batch.next_observation, &[], 0.0, false, actor);
        policy.sample(output, &draws.next_noise, view.config.log_std_bounds);
        if view.config.smoothness > 0.0 {
            policy.actions_without_noise(output, next_action);
        }
        batch.next_observation.set_extra(policy.actions(wanted.len()));
        wanted.fill(f32::INFINITY);
        for (critic, drops) in view.critics.iter().zip(&draws.drops) {
            let values = passes.target_values(critic, &batch.next_observation, drops);
            wanted.iter_mut().zip(values).for_each(|(least, &value)| *least = least.min(value));
        }
        for (row, wanted) in wanted.iter_mut().enumerate() {
            let value = *wanted - view.temperature * policy.log_prob[row];
            *wanted = batch.reward[row] + batch.discount[row] * value;
        }

        batch.observation.set_extra(&batch.action);
        (self.sums.squares, self.sums.q) = (0.0, 0.0);
        for ((critic, drops), gradient) in
            view.critics.iter().zip(&draws.drops).zip(&mut self.critic_gradients)
        {
            let (squares, sum) = passes.regress(critic, &batch.observation, wanted, drops, gradient);
            self.sums.squares += squares;
            self.sums.q += sum;
        }
    }

    /// Computes the gradient of the actor, and its entropy.
    pub(super) fn fit_actor(&mut self, view: &View<'_>) {
        let Self {
            batch, draws, actor, critic: passes, policy, next_action, output_error, action_error, ..
        } = self;
        let output = view.actor_network.forward(view.actor, &batch.observation, &[], 0.0, true, actor);
        policy.sample(output, &draws.noise, view.config.log_std_bounds);
        batch.observation.set_extra(policy.actions(batch.reward.len()));

        action_error.fill(0.0);
        let mut q = 0.0;
        for (critic, drops) in view.critics.iter().zip(&draws.drops) {
            q += passes.judge(critic, &batch.observation, drops);
            add_row(action_error, &passes.action_error);
        }
        let log_prob: f64 = policy.log_prob.iter().map(|&log_prob| f64::from(log_prob)).sum();
        self.sums.entropy = -log_prob;
        self.sums.actor = f64::from(view.temperature) * log_prob - q / CRITICS as f64;
        let weight = view.temperature / view.config.batch as f32;
        let bounds = view.config.log_std_bounds;
        policy.backward(output, &draws.noise, bounds, weight, action_error, output_error);
        if view.config.smoothness > 0.0 {
            let weight = view.config.smoothness as f32 / view.config.batch as f32;
            policy.backward_of_change(output, next_action, weight, output_error);
        }
        let wanted = Wanted::Parameters(&mut self.actor_gradient);
        view.actor_network.backward(view.actor, &batch.observation, &[], 0.0, output_error, wanted, actor);
    }
}
