//! Many environments over threads, for the learner.

use std::sync::Arc;

use etude_learn::{EnvironmentError, ObservationLayout, StepBatch, VectorEnvironment, seed};
use rayon::prelude::*;

use crate::environment::Environment;
use crate::observation::layout;
use crate::{ACTION_LEN, Corpus, Piece, TaskConfig, TaskError};

/// Environments of one piece, or of one corpus, that step together. Each owns its world and its
/// random stream, so the result does not depend on the number of threads.
pub struct PianoVectorEnv {
    environments: Vec<EnvironmentSlot>,
    layout: ObservationLayout,
    terms: usize,
}

/// An environment and the reward terms of its last step.
struct EnvironmentSlot {
    environment: Environment,
    parts: Vec<f32>,
}

impl PianoVectorEnv {
    /// `num_envs` environments whose randomness comes from `root_seed`.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn new(
        config: &TaskConfig,
        piece: &Piece,
        num_envs: usize,
        root_seed: u64,
    ) -> Result<Self, TaskError> {
        Self::of(config, num_envs, root_seed, |seed| Environment::new(config, piece, seed))
    }

    /// The same, each of which plays a new piece of `corpus` in every episode.
    ///
    /// # Errors
    /// If the configuration is not valid.
    pub fn of_corpus(
        config: &TaskConfig,
        corpus: &Arc<Corpus>,
        num_envs: usize,
        root_seed: u64,
    ) -> Result<Self, TaskError> {
        Self::of(config, num_envs, root_seed, |seed| Environment::of_corpus(config, corpus, seed))
    }

    fn of(
        config: &TaskConfig,
        num_envs: usize,
        root_seed: u64,
        make: impl Fn(u64) -> Result<Environment, TaskError>,
    ) -> Result<Self, TaskError> {
        let environments = (0..num_envs)
            .map(|index| {
                let seed = seed::split(root_seed, &format!("environment {index}"));
                let environment = make(seed)?;
                let parts = vec![0.0; environment.reward().names().len()];
                Ok(EnvironmentSlot { environment, parts })
            })
            .collect::<Result<Vec<_>, TaskError>>()?;
        let terms = environments.first().map_or(0, |slot| slot.parts.len());
        Ok(Self { environments, layout: layout(config), terms })
    }
}

impl VectorEnvironment for PianoVectorEnv {
    fn num_envs(&self) -> usize {
        self.environments.len()
    }

    fn layout(&self) -> ObservationLayout {
        self.layout
    }

    fn action_len(&self) -> usize {
        ACTION_LEN
    }

    fn reward_term_names(&self) -> Vec<String> {
        let names = |slot: &EnvironmentSlot| slot.environment.reward().names().map(str::to_string).collect();
        self.environments.first().map_or_else(Vec::new, names)
    }

    fn reset(&mut self, observation: &mut [f32]) {
        for (slot, row) in self.environments.iter_mut().zip(observation.chunks_exact_mut(self.layout.len())) {
            slot.environment.reset();
            slot.environment.observe(row);
        }
    }

    fn step(&mut self, actions: &[f32], batch: &mut StepBatch) {
        let len = self.layout.len();
        let rows = self
            .environments
            .par_iter_mut()
            .zip(actions.par_chunks_exact(ACTION_LEN))
            .zip(batch.observation.par_chunks_exact_mut(len))
            .zip(batch.next_observation.par_chunks_exact_mut(len))
            .zip(batch.reward.par_iter_mut())
            .zip(batch.truncated.par_iter_mut());
        rows.with_max_len(1).for_each(|(((((slot, action), observation), last), reward), truncated)| {
            let action = action.first_chunk().expect("an action has one value per joint");
            let result = slot.environment.advance(action, &mut slot.parts, observation, last);
            *reward = result.reward as f32;
            *truncated = result.song_over;
        });
        for (index, slot) in self.environments.iter().enumerate() {
            batch.reward_terms[index * self.terms..][..self.terms].copy_from_slice(&slot.parts);
        }
    }

    fn save_state(&self) -> Vec<u8> {
        let states: Vec<Vec<u8>> = self.environments.iter().map(|slot| slot.environment.save()).collect();
        states.join(&b'\n')
    }

    fn load_state(&mut self, state: &[u8]) -> Result<(), EnvironmentError> {
        let states: Vec<&[u8]> = state.split(|byte| *byte == b'\n').collect();
        if states.len() != self.environments.len() {
            return Err(EnvironmentError::new(format!(
                "it holds {} environments and this run has {}",
                states.len(),
                self.environments.len()
            )));
        }
        self.environments.iter_mut().zip(states).try_for_each(|(slot, bytes)| slot.environment.load(bytes))
    }
}
