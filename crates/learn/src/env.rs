//! The interface between learner and task: environments that step together, and an evaluator of
//! policies.
//!
//! The task crate implements these traits for the piano, the tests of this crate for toy problems.

use serde::{Deserialize, Serialize};

/// Columns of an observation: `real` values first, then `binary` values that are exactly 0 or 1.
///
/// The replay buffer stores binary columns as bits, and the first layer of every network adds up
/// the weight rows of the set bits instead of multiplying by zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObservationLayout {
    /// Number of leading real-valued columns.
    pub real: usize,
    /// Number of trailing columns that are exactly 0 or 1.
    pub binary: usize,
}

impl ObservationLayout {
    /// Length of one observation.
    pub fn len(&self) -> usize {
        self.real + self.binary
    }

    /// Whether an observation has no columns at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of 64-bit words that hold the binary columns of one observation.
    pub fn words(&self) -> usize {
        self.binary.div_ceil(64)
    }
}

/// Buffers that one vectorised step fills; `n` is the number of environments.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepBatch {
    /// `[n, observation]`: what to act on next, after restarting the episodes that ended.
    pub observation: Vec<f32>,
    /// `[n, observation]`: the result of the step, before restarting. The replay buffer stores this
    /// one.
    pub next_observation: Vec<f32>,
    /// `[n]`: the reward of the step.
    pub reward: Vec<f32>,
    /// `[n, terms]`: the named parts of the reward, in the order of
    /// [`VectorEnvironment::reward_term_names`].
    pub reward_terms: Vec<f32>,
    /// `[n]`: the episode was truncated (the song is over): bootstrapping continues. No state is
    /// terminal.
    pub truncated: Vec<bool>,
}

impl StepBatch {
    /// Zeroed buffers for `num_envs` environments.
    pub fn new(num_envs: usize, layout: ObservationLayout, reward_terms: usize) -> Self {
        Self {
            observation: vec![0.0; num_envs * layout.len()],
            next_observation: vec![0.0; num_envs * layout.len()],
            reward: vec![0.0; num_envs],
            reward_terms: vec![0.0; num_envs * reward_terms],
            truncated: vec![false; num_envs],
        }
    }
}

/// Environments that step together.
///
/// The same state and actions must give the same bytes with any number of threads, since
/// reproducible runs depend on it. The trainer calls [`step`](Self::step) inside its own rayon
/// pool, so an implementation that uses rayon shares its threads.
pub trait VectorEnvironment: Send {
    /// Number of environments that one step advances.
    fn num_envs(&self) -> usize;
    /// Columns of one observation.
    fn layout(&self) -> ObservationLayout;
    /// Length of one action.
    fn action_len(&self) -> usize;
    /// Names of the terms of the reward, under which they are logged.
    fn reward_term_names(&self) -> Vec<String>;
    /// Starts an episode in every environment and writes `[n, observation]`.
    fn reset(&mut self, observation: &mut [f32]);
    /// Applies `actions` (`[n, action]`, each in [-1, 1]) and restarts the episodes that ended.
    fn step(&mut self, actions: &[f32], batch: &mut StepBatch);
    /// The state, from which [`load_state`](Self::load_state) continues bit for bit.
    fn save_state(&self) -> Vec<u8>;
    /// Continues from the bytes of [`save_state`](Self::save_state).
    ///
    /// # Errors
    /// If the bytes are not such a state; it must not panic.
    fn load_state(&mut self, state: &[u8]) -> Result<(), EnvironmentError>;
}

/// An environment could not continue from a saved state.
#[derive(Debug, thiserror::Error)]
#[error("the environment cannot continue from this saved state: {message}")]
pub struct EnvironmentError {
    message: String,
}

impl EnvironmentError {
    /// `message` completes the sentence "the environment cannot continue from this saved state: …".
    pub fn new(message: impl Into<String>) -> Self {
        Self { message: message.into() }
    }
}

/// One named result of an evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Name, logged as `eval/<name>`.
    pub name: String,
    /// Value; larger is better for the first score of a list.
    pub value: f64,
}

/// Plays whole episodes with a fixed policy; one of the scores decides which policy is the best.
///
/// The scores must not depend on earlier calls, because a resumed training builds a new evaluator.
pub trait Evaluator: Send {
    /// `act(observations, actions)` maps `[k, observation]` to `[k, action]` without exploration,
    /// for any `k`.
    fn evaluate(&mut self, act: &mut (dyn FnMut(&[f32], &mut [f32]) + Send)) -> Vec<Score>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_round_up() {
        for (binary, words) in [(0, 0), (1, 1), (64, 1), (65, 2), (343, 6)] {
            assert_eq!(ObservationLayout { real: 26, binary }.words(), words);
        }
    }
}
