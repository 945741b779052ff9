//! One critic with its target, and the three things an update asks of it.

use super::{draws::CriticDrops, learned::Learned};
use crate::{
    buffer::Buffer,
    config::{Arithmetic, DroqConfig},
    kernels::{AdamStep, adam_polyak},
    network::{Inputs, Network, Wanted, Workspace},
};

/// A critic `Q(observation, action)`. Holds its own workspace, so that two critics can run on two threads.
#[derive(Clone)]
pub(crate) struct Critic {
    pub learned: Learned,
    pub target: Buffer,
    workspace: Workspace,
    /// `[batch]`: the last pass's values.
    pub values: Buffer,
    /// `[batch]`: gradient of the loss with respect to `values`.
    value_error: Buffer,
    /// `[batch, action]`: gradient of the actor's loss with respect to the action.
    pub action_error: Buffer,
}

impl Critic {
    pub(crate) fn new(network: &Network, parameters: Buffer, rows: usize, arithmetic: Arithmetic) -> Self {
        Self {
            target: parameters.clone(),
            learned: Learned::new(network, parameters),
            workspace: network.workspace(rows, true, arithmetic),
            values: Buffer::new(rows),
            value_error: Buffer::new(rows),
            action_error: Buffer::new(rows * network.shape.extra),
        }
    }

    /// The target critic's values at `inputs`, into `values`.
    pub(crate) fn target_values(
        &mut self,
        network: &Network,
        config: &DroqConfig,
        inputs: &Inputs,
        drops: &CriticDrops,
    ) {
        let values =
            network.forward(&self.target, inputs, &drops.target, config.dropout, false, &mut self.workspace);
        self.values.copy_from_slice(values);
    }

    /// Gradient of the critic loss: the mean over rows and over both critics of `(Q - wanted)²`. Returns this critic's
    /// sums over rows of the squared difference and of Q.
    pub(crate) fn regress(
        &mut self,
        network: &Network,
        config: &DroqConfig,
        inputs: &Inputs,
        wanted: &[f32],
        drops: &CriticDrops,
    ) -> (f64, f64) {
        let Learned { parameters, gradient, .. } = &mut self.learned;
        let values =
            network.forward(parameters, inputs, &drops.online, config.dropout, true, &mut self.workspace);
        // The derivative of a mean of squares over rows and critics.
        let per_value = 2.0 / (super::CRITICS * inputs.rows()) as f32;
        let (mut squares, mut sum) = (0.0, 0.0);
        for ((error, &value), &wanted) in self.value_error.iter_mut().zip(values).zip(wanted) {
            let difference = value - wanted;
            *error = difference * per_value;
            squares += f64::from(difference) * f64::from(difference);
            sum += f64::from(value);
        }
        let wanted = Wanted::Parameters(gradient);
        let (drops, rate) = (&drops.online, config.dropout);
        network.backward(parameters, inputs, drops, rate, &self.value_error, wanted, &mut self.workspace);
        (squares, sum)
    }

    /// Follows the gradient that [`regress`](Self::regress) left, and lets the target follow.
    pub(crate) fn step(&mut self, config: &DroqConfig, update: u64) {
        let step = AdamStep::new(config.critic_learning_rate, update);
        let Learned { parameters, gradient, mean, square } = &mut self.learned;
        adam_polyak(step, config.polyak as f32, parameters, gradient, mean, square, &mut self.target);
    }

    /// Values at the policy's actions, and the gradient of `-mean over rows and critics of Q` with respect to them.
    pub(crate) fn judge(
        &mut self,
        network: &Network,
        config: &DroqConfig,
        inputs: &Inputs,
        drops: &CriticDrops,
    ) {
        let parameters = &self.learned.parameters;
        let values =
            network.forward(parameters, inputs, &drops.actor, config.dropout, true, &mut self.workspace);
        self.values.copy_from_slice(values);
        self.value_error.fill(-1.0 / (super::CRITICS * inputs.rows()) as f32);
        let wanted = Wanted::Extra(&mut self.action_error);
        let (drops, rate) = (&drops.actor, config.dropout);
        network.backward(parameters, inputs, drops, rate, &self.value_error, wanted, &mut self.workspace);
    }
}
