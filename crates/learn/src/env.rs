//! What the learner knows about a task: a batch of environments that step together, and a judge of finished policies.
//!
//! Nothing here mentions music, robots or physics. The task crate implements these traits; the tests of this crate
//! implement them with one-line toy problems.

use serde::{Deserialize, Serialize};

/// Columns of an observation: `real` values first, then `binary` values that are exactly 0 or 1.
///
/// The split is worth naming because it pays twice: the replay stores binary columns as bits, and the first layer of
/// every network adds up the weight rows of the set bits instead of multiplying by zeros.
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
    /// `[n, observation]`: what to act on next, after episodes that ended have been restarted.
    pub observation: Vec<f32>,
    /// `[n, observation]`: what the step itself led to, before any restart. This is what the replay stores.
    pub next_observation: Vec<f32>,
    /// `[n]`: the reward of the step.
    pub reward: Vec<f32>,
    /// `[n, terms]`: the named parts of the reward, in the order of [`VectorEnvironment::reward_term_names`].
    pub reward_terms: Vec<f32>,
    /// `[n]`: the task ended for good; nothing after this step is worth anything, so bootstrapping stops.
    pub terminal: Vec<bool>,
    /// `[n]`: the episode ended for a reason outside the task (the song is over); bootstrapping goes on.
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
            terminal: vec![false; num_envs],
            truncated: vec![false; num_envs],
        }
    }
}

/// Environments that step together.
///
/// Same state and same actions must give the same bytes, whatever the number of threads: the trainer's promise of
/// reproducible runs rests on it. The trainer calls [`step`](Self::step) from inside its own rayon pool, so an
/// implementation that uses rayon shares the trainer's threads.
pub trait VectorEnvironment: Send {
    /// Number of environments that one step advances.
    fn num_envs(&self) -> usize;
    /// Columns of one observation.
    fn layout(&self) -> ObservationLayout;
    /// Length of one action.
    fn action_len(&self) -> usize;
    /// Names of the parts of the reward; metrics are logged under these.
    fn reward_term_names(&self) -> Vec<String>;
    /// Starts an episode in every environment and writes `[n, observation]`.
    fn reset(&mut self, observation: &mut [f32]);
    /// Applies `actions` (`[n, action]`, each in [-1, 1]) and restarts the episodes that ended.
    fn step(&mut self, actions: &[f32], batch: &mut StepBatch);
    /// Writes what a demonstrator that knows the task would do now, `[n, action]`. Without one: `false`, and nothing
    /// is written.
    fn demonstrate(&self, actions: &mut [f32]) -> bool {
        let _ = actions;
        false
    }
    /// Everything that is needed to continue bit for bit after [`load_state`](Self::load_state).
    fn save_state(&self) -> Vec<u8>;
    /// Continues from [`save_state`](Self::save_state). Must refuse, not panic on, bytes that it did not write.
    fn load_state(&mut self, state: &[u8]) -> Result<(), EnvironmentError>;
}

/// An environment could not continue from the saved state that it was given.
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

/// Plays whole episodes with a fixed policy; the first score chooses the best checkpoint.
///
/// An evaluator must not remember anything between calls that changes its scores: a resumed training builds a new one.
pub trait Evaluator: Send {
    /// `act(observations, actions)` maps `[k, observation]` to `[k, action]` without exploration, for any `k`.
    fn evaluate(&mut self, act: &mut dyn FnMut(&[f32], &mut [f32])) -> Vec<Score>;
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
