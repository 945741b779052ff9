//! One critic with its target, and the three passes that an update sends through it.

use super::{draws::CriticDrops, trainable::Trainable};
use crate::{
    buffer::Buffer,
    config::DroqConfig,
    kernels::{AdamStep, adam_polyak},
    network::{GradientOf, Inputs, Network, Workspace},
};

/// A critic `Q(observation, action)`.
#[derive(Clone)]
pub(crate) struct Critic {
    pub trainable: Trainable,
    pub target: Buffer,
}

impl Critic {
    pub(crate) fn new(network: &Network, parameters: Buffer) -> Self {
        Self { target: parameters.clone(), trainable: Trainable::new(network, parameters) }
    }

    /// Updates the parameters by the sum of the shards' gradients, then the target.
    pub(crate) fn step<'a>(
        &mut self,
        config: &DroqConfig,
        update: u64,
        gradients: impl Iterator<Item = &'a [f32]> + Clone,
    ) {
        self.trainable.gather(gradients);
        let step = AdamStep::new(config.critic_learning_rate, update);
        let Trainable { parameters, gradient, mean, square } = &mut self.trainable;
        adam_polyak(step, config.polyak as f32, parameters, gradient, mean, square, &mut self.target);
    }
}

/// Passes of a shard's rows through one of the critics.
#[derive(Clone)]
pub(crate) struct CriticPasses {
    network: Network,
    dropout: f64,
    /// Rows of the whole batch, over which the losses are means.
    batch: usize,
    workspace: Workspace,
    /// `[rows]`: gradient of the loss with respect to the values.
    value_error: Buffer,
    /// Gradient of the critic's loss.
    pub gradient: Buffer,
    /// `[rows, action]`: gradient of the actor's loss with respect to the action.
    pub action_error: Buffer,
}

impl CriticPasses {
    pub(crate) fn new(network: &Network, config: &DroqConfig, rows: usize) -> Self {
        Self {
            network: network.clone(),
            dropout: config.dropout,
            batch: config.batch,
            workspace: network.workspace(rows, true, config.arithmetic),
            value_error: Buffer::new(rows),
            gradient: network.parameters(),
            action_error: Buffer::new(rows * network.shape.extra),
        }
    }

    /// `[rows]`: a target critic's values at `inputs`.
    pub(crate) fn target_values(&mut self, critic: &Critic, inputs: &Inputs, drops: &CriticDrops) -> &[f32] {
        let Self { network, dropout, workspace, .. } = self;
        network.forward(&critic.target, inputs, &drops.target, *dropout, false, workspace)
    }

    /// Leaves the gradient of the critic loss in `gradient`, the mean over the batch and both
    /// critics of `(Q - target)²`. Returns this critic's sums over rows of the squared difference
    /// and of Q.
    pub(crate) fn regress(
        &mut self,
        critic: &Critic,
        inputs: &Inputs,
        targets: &[f32],
        drops: &CriticDrops,
    ) -> (f64, f64) {
        let Self { network, dropout, batch, workspace, value_error, gradient, .. } = self;
        let parameters = &critic.trainable.parameters;
        let values = network.forward(parameters, inputs, &drops.online, *dropout, true, workspace);
        // The derivative of a mean of squares over rows and critics.
        let per_value = 2.0 / (super::CRITICS * *batch) as f32;
        let (mut squares, mut sum) = (0.0, 0.0);
        for ((error, &value), &target) in value_error.iter_mut().zip(values).zip(targets) {
            let difference = value - target;
            *error = difference * per_value;
            squares += f64::from(difference) * f64::from(difference);
            sum += f64::from(value);
        }
        let of = GradientOf::Parameters(gradient);
        network.backward(parameters, inputs, &drops.online, *dropout, value_error, of, workspace);
        (squares, sum)
    }

    /// Leaves the gradient of `-mean over the batch and critics of Q` with respect to the policy's
    /// actions in `action_error`. Returns the sum of Q over rows.
    pub(crate) fn actor_loss(&mut self, critic: &Critic, inputs: &Inputs, drops: &CriticDrops) -> f64 {
        let Self { network, dropout, batch, workspace, value_error, action_error, .. } = self;
        let parameters = &critic.trainable.parameters;
        let values = network.forward(parameters, inputs, &drops.actor, *dropout, true, workspace);
        let sum = values.iter().map(|&value| f64::from(value)).sum();
        value_error.fill(-1.0 / (super::CRITICS * *batch) as f32);
        let of = GradientOf::Extra(action_error);
        network.backward(parameters, inputs, &drops.actor, *dropout, value_error, of, workspace);
        sum
    }
}
