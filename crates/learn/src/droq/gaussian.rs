//! The policy's distribution: a diagonal Gaussian with state-dependent deviation, squashed by tanh
//! into [-1, 1].

use crate::{
    buffer::Buffer,
    kernels::{exp_in_place, squash},
};

/// ½ ln 2π.
const HALF_LOG_TWO_PI: f32 = 0.918_938_5;

/// Samples of a batch and what their gradient needs. `[rows, action]` unless said otherwise.
#[derive(Clone)]
pub(crate) struct Gaussian {
    action_len: usize,
    /// Logarithm of the deviation, clipped.
    log_std: Buffer,
    std: Buffer,
    /// Sample before squashing.
    raw: Buffer,
    pub(crate) action: Buffer,
    /// ln(1 - action²).
    log_slope: Buffer,
    /// `[rows]`: log-density of the squashed sample.
    pub(crate) log_prob: Buffer,
}

impl Gaussian {
    pub(crate) fn new(action_len: usize, capacity: usize) -> Self {
        let values = || Buffer::new(capacity * action_len);
        Self {
            action_len,
            log_std: values(),
            std: values(),
            raw: values(),
            action: values(),
            log_slope: values(),
            log_prob: Buffer::new(capacity),
        }
    }

    /// Draws `action = tanh(mean + std · noise)` for as many rows as `noise` (`[rows, action]`)
    /// has.
    ///
    /// `output` is the actor's head, `[rows, 2 · action]`: means, then unclipped logarithms of
    /// deviations.
    pub(crate) fn sample(&mut self, output: &[f32], noise: &[f32], [low, high]: [f64; 2]) {
        let (n, len) = (self.action_len, noise.len());
        for (to, row) in self.log_std.chunks_exact_mut(n).zip(output.chunks_exact(2 * n)) {
            for (to, &value) in to.iter_mut().zip(&row[n..]) {
                *to = value.clamp(low as f32, high as f32);
            }
        }
        self.std[..len].copy_from_slice(&self.log_std[..len]);
        exp_in_place(&mut self.std[..len]);
        for (index, row) in output.chunks_exact(2 * n).enumerate() {
            let columns = index * n..(index + 1) * n;
            let spreads = self.std[columns.clone()].iter().zip(&noise[columns.clone()]);
            for ((raw, &mean), (&std, &noise)) in self.raw[columns].iter_mut().zip(row).zip(spreads) {
                *raw = mean + std * noise;
            }
        }
        squash(&self.raw[..len], &mut self.action[..len], &mut self.log_slope[..len]);
        for (index, log_prob) in self.log_prob[..len / n].iter_mut().enumerate() {
            *log_prob = (index * n..(index + 1) * n)
                .map(|at| {
                    -0.5 * noise[at] * noise[at] - self.log_std[at] - HALF_LOG_TWO_PI - self.log_slope[at]
                })
                .sum();
        }
    }

    /// `[rows, action]` of the last sample of `rows` rows.
    pub(crate) fn actions(&self, rows: usize) -> &[f32] {
        &self.action[..rows * self.action_len]
    }

    /// The actions `tanh(mean)` (`[rows, action]`) that the actor's head asks for.
    pub(crate) fn actions_without_noise(&self, output: &[f32], actions: &mut [f32]) {
        let n = self.action_len;
        for (actions, row) in actions.chunks_exact_mut(n).zip(output.chunks_exact(2 * n)) {
            actions.iter_mut().zip(row).for_each(|(action, &mean)| *action = mean.tanh());
        }
    }

    /// Adds to `output_error` the gradient of `weight · Σ over rows of the mean over actions of
    /// (tanh(mean) - next)²`, where `next` (`[rows, action]`) is held.
    pub(crate) fn backward_of_change(
        &self,
        output: &[f32],
        next: &[f32],
        weight: f32,
        output_error: &mut [f32],
    ) {
        let n = self.action_len;
        let rows = output.chunks_exact(2 * n).zip(output_error.chunks_exact_mut(2 * n));
        for ((row, error), next) in rows.zip(next.chunks_exact(n)) {
            for ((error, &mean), &next) in error.iter_mut().zip(&row[..n]).zip(next) {
                let action = mean.tanh();
                *error += 2.0 * weight / n as f32 * (action - next) * (1.0 - action * action);
            }
        }
    }

    /// Gradient of `Σ over rows of (weight · log_prob + Σ action · action_error)` with respect to
    /// the actor's head, into `output_error` (`[rows, 2 · action]`); `action_error` is `[rows,
    /// action]`.
    ///
    /// With `u = mean + std · noise`, `∂ log_prob / ∂u = 2 tanh u` (the noise is fixed) and `∂
    /// log_prob / ∂ log_std` adds -1. Where the clip acts, the deviation has no gradient.
    pub(crate) fn backward(
        &self,
        output: &[f32],
        noise: &[f32],
        [low, high]: [f64; 2],
        weight: f32,
        action_error: &[f32],
        output_error: &mut [f32],
    ) {
        let n = self.action_len;
        for (index, (row, error)) in
            output.chunks_exact(2 * n).zip(output_error.chunks_exact_mut(2 * n)).enumerate()
        {
            for j in 0..n {
                let at = index * n + j;
                let action = self.action[at];
                let raw_error = weight * 2.0 * action + action_error[at] * (1.0 - action * action);
                error[j] = raw_error;
                let inside = row[n + j] > low as f32 && row[n + j] < high as f32;
                error[n + j] = if inside { raw_error * self.std[at] * noise[at] - weight } else { 0.0 };
            }
        }
    }
}
