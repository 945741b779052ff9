//! The environments and the actions in them: what fills the replay buffer.

use super::error::TrainError;
use crate::{
    actor_inference::ActorInference,
    config::{DroqConfig, TrainerConfig},
    droq::Droq,
    env::{StepBatch, VectorEnvironment},
    random::Stream,
    replay::{Replay, Transition},
};

/// The environments, the streams that their actions are drawn from, and the buffers of a step.
pub(super) struct Collector {
    pub environment: Box<dyn VectorEnvironment>,
    actor: ActorInference,
    log_std_bounds: [f64; 2],
    pub policy_stream: Stream,
    pub warmup_stream: Stream,
    /// `[n, observation]`: the current observations.
    pub observation: Vec<f32>,
    /// `[n, action]` each.
    action: Vec<f32>,
    noise: Vec<f32>,
    batch: StepBatch,
}

impl Collector {
    pub(super) fn new(
        environment: Box<dyn VectorEnvironment>,
        droq: &Droq,
        droq_config: &DroqConfig,
        config: &TrainerConfig,
    ) -> Self {
        let (n, layout) = (environment.num_envs(), environment.layout());
        let actions = vec![0.0; n * environment.action_len()];
        Self {
            actor: ActorInference::new(droq.actor_network(), n),
            log_std_bounds: droq_config.log_std_bounds,
            policy_stream: Stream::new(config.seed, "trainer/policy"),
            warmup_stream: Stream::new(config.seed, "trainer/warmup"),
            observation: vec![0.0; n * layout.len()],
            action: actions.clone(),
            noise: actions,
            batch: StepBatch::new(n, layout, environment.reward_term_names().len()),
            environment,
        }
    }

    /// Begins an episode in every environment.
    pub(super) fn reset(&mut self) {
        self.environment.reset(&mut self.observation);
    }

    /// Draws uniformly random actions.
    pub(super) fn draw_random_actions(&mut self) {
        self.action.fill_with(|| 2.0 * self.warmup_stream.uniform() - 1.0);
    }

    /// Draws the actor's actions at the current observations.
    pub(super) fn draw_actions(&mut self, parameters: &[f32]) {
        self.policy_stream.fill_normal(&mut self.noise);
        let Self { observation, noise, action, .. } = self;
        self.actor.explore(parameters, observation, noise, self.log_std_bounds, action);
    }

    /// Applies the actions in all environments.
    pub(super) fn step(&mut self) {
        self.environment.step(&self.action, &mut self.batch);
    }

    /// The results of the last step, unless one is not finite; `step` is named in the error.
    pub(super) fn batch(&self, step: u64) -> Result<&StepBatch, TrainError> {
        let StepBatch { observation, next_observation, reward, reward_terms, .. } = &self.batch;
        let results = [next_observation, observation, reward, reward_terms];
        if results.into_iter().flatten().all(|value| value.is_finite()) {
            return Ok(&self.batch);
        }
        let what = "an observation or a reward of the environment (unstable physics?)".to_owned();
        Err(TrainError::NotFinite { what, step })
    }

    /// Appends the transitions of the last step to `replay`; its results become the current
    /// observations.
    pub(super) fn store(&mut self, replay: &mut Replay) {
        let Self { environment, observation, action, batch, .. } = self;
        let (len, action_len) = (environment.layout().len(), environment.action_len());
        for index in 0..environment.num_envs() {
            let observations = index * len..(index + 1) * len;
            replay.push(Transition {
                observation: &observation[observations.clone()],
                action: &action[index * action_len..(index + 1) * action_len],
                reward: batch.reward[index],
                ends: batch.truncated[index],
                next_observation: &batch.next_observation[observations],
            });
        }
        observation.copy_from_slice(&batch.observation);
    }
}
