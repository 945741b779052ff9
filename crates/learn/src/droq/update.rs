//! One update, given its batch and its draws.

use super::{Droq, Learned, Losses, Scratch};
use crate::kernels::{AdamStep, adam, adam_polyak};

impl Droq {
    /// Uses the batch and the draws that lie in the scratch space.
    pub(super) fn update(&mut self, parallel: bool) -> Losses {
        self.updates += 1;
        let (critic, q_mean) = self.update_critics(parallel);
        let (actor, entropy) = self.update_actor(parallel);
        let temperature = self.update_temperature(entropy);
        Losses { critic, actor, temperature, entropy, q_mean }
    }

    /// Returns the critic loss and the mean Q.
    fn update_critics(&mut self, parallel: bool) -> (f64, f64) {
        let temperature = self.log_temperature.value.exp();
        let (config, network) = (&self.config, &self.critic_network);
        let Scratch { batch, draws, actor, next_policy, wanted, .. } = &mut self.scratch;
        let rows = batch.rows();

        let output = self.actor_network.forward(
            &self.actor.parameters,
            &batch.next_observation,
            &[],
            0.0,
            false,
            actor,
        );
        next_policy.sample(output, &draws.next_noise, config.log_std_bounds);
        batch.next_observation.set_extra(next_policy.actions(rows));

        let [first, second] = &mut self.critics;
        let [first_drops, second_drops] = &draws.drops;
        let inputs = &batch.next_observation;
        both(
            parallel,
            || first.target_values(network, config, inputs, first_drops),
            || second.target_values(network, config, inputs, second_drops),
        );
        for (row, wanted) in wanted.iter_mut().enumerate() {
            let value = first.values[row].min(second.values[row]) - temperature * next_policy.log_prob[row];
            *wanted = batch.reward[row] + batch.discount[row] * value;
        }

        batch.observation.set_extra(&batch.action);
        let (inputs, wanted, updates) = (&batch.observation, &wanted[..], self.updates);
        let ((first_squares, first_sum), (second_squares, second_sum)) = both(
            parallel,
            || {
                let sums = first.regress(network, config, inputs, wanted, first_drops);
                first.step(config, updates);
                sums
            },
            || {
                let sums = second.regress(network, config, inputs, wanted, second_drops);
                second.step(config, updates);
                sums
            },
        );
        let count = (super::CRITICS * rows) as f64;
        ((first_squares + second_squares) / count, (first_sum + second_sum) / count)
    }

    /// Returns the actor loss and the entropy.
    fn update_actor(&mut self, parallel: bool) -> (f64, f64) {
        let temperature = self.log_temperature.value.exp();
        let (config, network) = (&self.config, &self.critic_network);
        let Scratch { batch, draws, actor, policy, output_error, action_error, .. } = &mut self.scratch;
        let rows = batch.rows();

        let Learned { parameters, gradient, mean, square } = &mut self.actor;
        let output = self.actor_network.forward(parameters, &batch.observation, &[], 0.0, true, actor);
        policy.sample(output, &draws.noise, config.log_std_bounds);
        batch.observation.set_extra(policy.actions(rows));

        let [first, second] = &mut self.critics;
        let [first_drops, second_drops] = &draws.drops;
        let inputs = &batch.observation;
        both(
            parallel,
            || first.judge(network, config, inputs, first_drops),
            || second.judge(network, config, inputs, second_drops),
        );
        let (mut loss, mut entropy) = (0.0, 0.0);
        for row in 0..rows {
            let log_prob = f64::from(policy.log_prob[row]);
            let value = 0.5 * (f64::from(first.values[row]) + f64::from(second.values[row]));
            loss += f64::from(temperature) * log_prob - value;
            entropy -= log_prob;
        }
        for ((sum, &a), &b) in
            action_error.iter_mut().zip(first.action_error.iter()).zip(second.action_error.iter())
        {
            *sum = a + b;
        }
        policy.backward(output, &draws.noise, config.log_std_bounds, temperature, action_error, output_error);
        let wanted = crate::network::Wanted::Parameters(gradient);
        self.actor_network.backward(parameters, inputs, &[], 0.0, output_error, wanted, actor);
        let step = AdamStep::new(config.actor_learning_rate, self.updates);
        if config.policy_polyak < 1.0 {
            let polyak = config.policy_polyak as f32;
            adam_polyak(step, polyak, parameters, gradient, mean, square, &mut self.policy);
        } else {
            adam(step, parameters, gradient, mean, square);
            self.policy.copy_from_slice(parameters);
        }
        (loss / rows as f64, entropy / rows as f64)
    }

    /// Returns the temperature loss.
    pub(super) fn update_temperature(&mut self, entropy: f64) -> f64 {
        let target = self.config.target_entropy_per_action * self.action_len as f64;
        // With temperature = e^x, the loss is its own derivative with respect to x.
        let loss = f64::from(self.log_temperature.value.exp()) * (entropy - target);
        let scalar = &mut self.log_temperature;
        let step = AdamStep::new(self.config.temperature_learning_rate, self.updates);
        adam(
            step,
            std::slice::from_mut(&mut scalar.value),
            &[loss as f32],
            std::slice::from_mut(&mut scalar.mean),
            std::slice::from_mut(&mut scalar.square),
        );
        loss
    }
}

/// Both results; on two threads of the current rayon pool when `parallel`.
fn both<A: Send, B: Send>(
    parallel: bool,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    if parallel { rayon::join(first, second) } else { (first(), second()) }
}
