//! The actor outside of updates: actions for batches of observations, with or without exploration.

use crate::{
    config::Arithmetic,
    droq::Gaussian,
    kernels::squash,
    network::{Inputs, Network, Workspace},
};

/// Buffers for actor passes over any number of rows, `capacity` at a time.
#[derive(Clone)]
pub(crate) struct ActorInference {
    network: Network,
    action_len: usize,
    inputs: Inputs,
    workspace: Workspace,
    gaussian: Gaussian,
    /// `[capacity, action]`
    means: Vec<f32>,
    unused: Vec<f32>,
}

impl ActorInference {
    pub(crate) fn new(network: &Network, capacity: usize) -> Self {
        let action_len = network.shape.outputs / 2;
        Self {
            workspace: network.workspace(capacity, false, Arithmetic::F32),
            inputs: Inputs::new(network.shape.layout, 0, capacity),
            gaussian: Gaussian::new(action_len, capacity),
            means: vec![0.0; capacity * action_len],
            unused: vec![0.0; capacity * action_len],
            network: network.clone(),
            action_len,
        }
    }

    pub(crate) fn network(&self) -> &Network {
        &self.network
    }

    /// Best actions without exploration: `tanh(mean)` for `[rows, observation]`, into `[rows,
    /// action]`.
    pub(crate) fn best(&mut self, parameters: &[f32], observations: &[f32], actions: &mut [f32]) {
        let n = self.action_len;
        let (mut means, mut unused) = (std::mem::take(&mut self.means), std::mem::take(&mut self.unused));
        self.each(parameters, observations, actions, |_, output, _, actions| {
            for (mean, row) in means.chunks_exact_mut(n).zip(output.chunks_exact(2 * n)) {
                mean.copy_from_slice(&row[..n]);
            }
            squash(&means[..actions.len()], actions, &mut unused[..actions.len()]);
        });
        (self.means, self.unused) = (means, unused);
    }

    /// Samples of the policy for `[rows, observation]`, with `noise` (`[rows, action]`, standard
    /// normal), into `[rows, action]`.
    pub(crate) fn explore(
        &mut self,
        parameters: &[f32],
        observations: &[f32],
        noise: &[f32],
        log_std_bounds: [f64; 2],
        actions: &mut [f32],
    ) {
        let n = self.action_len;
        self.each(parameters, observations, actions, |gaussian, output, start, actions| {
            let noise = &noise[start..start + actions.len()];
            gaussian.sample(output, noise, log_std_bounds);
            actions.copy_from_slice(gaussian.actions(noise.len() / n));
        });
    }

    /// Runs the network over batches of rows. `finish(gaussian, head, offset into actions,
    /// actions)` is called for each batch.
    fn each(
        &mut self,
        parameters: &[f32],
        observations: &[f32],
        actions: &mut [f32],
        mut finish: impl FnMut(&mut Gaussian, &[f32], usize, &mut [f32]),
    ) {
        let (len, n) = (self.network.shape.layout.len(), self.action_len);
        assert!(
            observations.len().is_multiple_of(len) && observations.len() * n == actions.len() * len,
            "observations and actions must have equally many rows"
        );
        let capacity = self.inputs.capacity();
        let batches = observations.chunks(capacity * len).zip(actions.chunks_mut(capacity * n));
        for (index, (observations, actions)) in batches.enumerate() {
            self.inputs.clear();
            observations.chunks_exact(len).for_each(|observation| self.inputs.push(observation));
            let output = self.network.forward(parameters, &self.inputs, &[], 0.0, false, &mut self.workspace);
            finish(&mut self.gaussian, output, index * capacity * n, actions);
        }
    }
}
