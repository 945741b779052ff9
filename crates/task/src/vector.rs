//! Many environments over threads, for the learner.

use etude_learn::{EnvironmentError, ObservationLayout, StepBatch, VectorEnvironment, seed};
use rayon::prelude::*;

use crate::environment::Environment;
use crate::observation::layout;
use crate::{ACTION_LEN, Piece, TaskConfig, TaskError};

/// Environments of one piece that step together. Each owns its world and its stream of randomness, so the number of
/// threads cannot change what happens.
pub struct VectorPiano {
    environments: Vec<Environment>,
    layout: ObservationLayout,
    terms: usize,
}

impl VectorPiano {
    /// `num_envs` environments whose randomness comes from `root_seed`.
    ///
    /// # Errors
    /// If the configuration is not sound.
    pub fn new(
        config: &TaskConfig,
        piece: &Piece,
        num_envs: usize,
        root_seed: u64,
    ) -> Result<Self, TaskError> {
        let environments = (0..num_envs)
            .map(|index| {
                Environment::new(config, piece, seed::split(root_seed, &format!("environment {index}")))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let terms = environments.first().map_or(0, |e| e.reward().names().len());
        Ok(Self { environments, layout: layout(config), terms })
    }
}

/// One environment with its rows of the batch.
struct Row<'a> {
    environment: &'a mut Environment,
    action: &'a [f32],
    observation: &'a mut [f32],
    next_observation: &'a mut [f32],
    parts: &'a mut [f32],
    reward: &'a mut f32,
    truncated: &'a mut bool,
}

impl Row<'_> {
    fn step(self) {
        let action: &[f32; ACTION_LEN] =
            self.action.first_chunk().expect("an action has one value per joint");
        let step = self.environment.step(action, self.parts);
        *self.reward = step.reward as f32;
        *self.truncated = step.song_over;
        self.environment.observe(self.next_observation);
        if step.song_over {
            self.environment.reset();
            self.environment.observe(self.observation);
        } else {
            self.observation.copy_from_slice(self.next_observation);
        }
    }
}

impl VectorEnvironment for VectorPiano {
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
        self.environments.first().map_or_else(Vec::new, |e| e.reward().names().map(str::to_string).collect())
    }

    fn reset(&mut self, observation: &mut [f32]) {
        for (environment, row) in
            self.environments.iter_mut().zip(observation.chunks_exact_mut(self.layout.len()))
        {
            environment.reset();
            environment.observe(row);
        }
    }

    fn step(&mut self, actions: &[f32], batch: &mut StepBatch) {
        let len = self.layout.len();
        batch.terminal.fill(false);
        // One slice for each environment, empty ones where the reward has no terms.
        let mut rest = batch.reward_terms.as_mut_slice();
        let mut parts = Vec::with_capacity(self.environments.len());
        for _ in 0..self.environments.len() {
            let (row, others) = rest.split_at_mut(self.terms);
            parts.push(row);
            rest = others;
        }
        let rows = self
            .environments
            .par_iter_mut()
            .zip(actions.par_chunks_exact(ACTION_LEN))
            .zip(batch.observation.par_chunks_exact_mut(len))
            .zip(batch.next_observation.par_chunks_exact_mut(len))
            .zip(parts)
            .zip(batch.reward.par_iter_mut())
            .zip(batch.truncated.par_iter_mut());
        rows.with_max_len(1).for_each(
            |((((((environment, action), observation), next_observation), parts), reward), truncated)| {
                Row { environment, action, observation, next_observation, parts, reward, truncated }.step();
            },
        );
    }

    fn save_state(&self) -> Vec<u8> {
        let states: Vec<Vec<u8>> = self.environments.iter().map(Environment::save).collect();
        let texts: Vec<&str> = states.iter().filter_map(|s| std::str::from_utf8(s).ok()).collect();
        texts.join("\n").into_bytes()
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
        self.environments.iter_mut().zip(states).try_for_each(|(environment, bytes)| environment.load(bytes))
    }
}
