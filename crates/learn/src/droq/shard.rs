//! A part of the batch, which one thread processes, or two: one a critic.
//!
//! The parameters do not change while shards are processed. Each shard computes its part of each
//! gradient; the parts are added up in the order of the shards, so the bytes do not depend on the
//! threads.

use super::{
    critic::{Critic, CriticPasses},
    draws::{CRITICS, Draws, ShardStreams},
    gaussian::Gaussian,
};
use crate::{
    buffer::Buffer,
    config::DroqConfig,
    kernels::add_row,
    network::{GradientOf, Network, Workspace},
    replay::{Batch, Horizon, Replay},
};

/// Rows of a shard. With 64 an update is 10 % slower, since every product packs its weights twice
/// as often.
pub(super) const ROWS: usize = 128;
/// Maximum number of shards of a batch; each has buffers for all gradients.
pub(super) const MAX_SHARDS: usize = 16;

/// What the shards of an update read.
pub(super) struct UpdateInputs<'a> {
    pub config: &'a DroqConfig,
    pub actor_network: &'a Network,
    /// The actor's parameters.
    pub actor: &'a [f32],
    pub critics: &'a [Critic; CRITICS],
    pub temperature: f32,
    /// Whether the critics' passes may run on two threads of the current rayon pool.
    pub parallel: bool,
}

impl UpdateInputs<'_> {
    /// Calls `pass` for both critics. A batch of one shard thus keeps two threads busy.
    fn both<'a, T: Send>(
        &self,
        [first, second]: &'a mut [CriticPasses; CRITICS],
        pass: impl Fn(usize, &'a mut CriticPasses) -> T + Sync,
    ) -> [T; CRITICS] {
        if self.parallel {
            rayon::join(|| pass(0, first), || pass(1, second)).into()
        } else {
            [pass(0, first), pass(1, second)]
        }
    }
}

/// Sums over a shard's rows.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    /// `(Q - target)²` and Q, over both critics.
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
    pub passes: [CriticPasses; CRITICS],
    actor: Workspace,
    policy: Gaussian,
    /// `[rows, action]`: the policy's actions in the next observations, without exploration.
    next_action: Vec<f32>,
    /// `[rows]`: target values of the critics.
    targets: Vec<f32>,
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
            passes: [(); CRITICS].map(|()| CriticPasses::new(critic_network, config, rows)),
            actor: actor_network.workspace(rows, true, config.arithmetic),
            policy: Gaussian::new(action_len, rows),
            next_action: vec![0.0; rows * action_len],
            targets: vec![0.0; rows],
            output_error: vec![0.0; rows * 2 * action_len],
            action_error: vec![0.0; rows * action_len],
        }
    }

    /// Draws the rows and all other random numbers of the next update.
    pub(super) fn draw(&mut self, config: &DroqConfig, replay: &Replay) {
        let (rows, horizon) =
            (self.targets.len(), Horizon { steps: config.n_step, discount: config.discount });
        replay.sample(&mut self.streams.replay, rows, horizon, &mut self.batch);
        self.draws.fill(config, rows, &mut self.streams);
    }

    /// Computes the gradients of the critics.
    pub(super) fn fit_critics(&mut self, update: &UpdateInputs<'_>) {
        let Self { batch, draws, actor, passes, policy, next_action, targets, .. } = self;
        let output =
            update.actor_network.forward(update.actor, &batch.next_observation, &[], 0.0, false, actor);
        policy.sample(output, &draws.next_noise, update.config.log_std_bounds);
        if update.config.smoothness > 0.0 {
            policy.actions_without_noise(output, next_action);
        }
        batch.next_observation.set_extra(policy.actions(targets.len()));
        let inputs = &batch.next_observation;
        let [first, second] = update.both(passes, |index, passes| {
            passes.target_values(&update.critics[index], inputs, &draws.drops[index])
        });
        for ((target, &first), &second) in targets.iter_mut().zip(first).zip(second) {
            *target = first.min(second);
        }
        for (row, target) in targets.iter_mut().enumerate() {
            let value = *target - update.temperature * policy.log_prob[row];
            *target = batch.reward[row] + batch.discount[row] * value;
        }

        batch.observation.set_extra(&batch.action);
        let inputs = &batch.observation;
        let [first, second] = update.both(passes, |index, passes| {
            passes.regress(&update.critics[index], inputs, targets, &draws.drops[index])
        });
        (self.sums.squares, self.sums.q) = (first.0 + second.0, first.1 + second.1);
    }

    /// Computes the gradient of the actor, and its entropy.
    pub(super) fn fit_actor(&mut self, update: &UpdateInputs<'_>) {
        let Self { batch, draws, actor, passes, policy, next_action, output_error, action_error, .. } = self;
        let output = update.actor_network.forward(update.actor, &batch.observation, &[], 0.0, true, actor);
        policy.sample(output, &draws.noise, update.config.log_std_bounds);
        batch.observation.set_extra(policy.actions(batch.reward.len()));

        let inputs = &batch.observation;
        let [first, second] = update.both(passes, |index, passes| {
            passes.actor_loss(&update.critics[index], inputs, &draws.drops[index])
        });
        let q = first + second;
        action_error.fill(0.0);
        passes.iter().for_each(|passes| add_row(action_error, &passes.action_error));
        let log_prob: f64 = policy.log_prob.iter().map(|&log_prob| f64::from(log_prob)).sum();
        self.sums.entropy = -log_prob;
        self.sums.actor = f64::from(update.temperature) * log_prob - q / CRITICS as f64;
        let weight = update.temperature / update.config.batch as f32;
        let bounds = update.config.log_std_bounds;
        policy.backward(output, &draws.noise, bounds, weight, action_error, output_error);
        if update.config.smoothness > 0.0 {
            let weight = update.config.smoothness as f32 / update.config.batch as f32;
            policy.backward_of_change(output, next_action, weight, output_error);
        }
        let of = GradientOf::Parameters(&mut self.actor_gradient);
        update.actor_network.backward(update.actor, &batch.observation, &[], 0.0, output_error, of, actor);
    }
}
