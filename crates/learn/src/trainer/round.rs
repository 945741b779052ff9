//! One round: choose actions, step the environments while the learner updates, then store the transitions.
//!
//! The updates draw from the replay buffer as it was before the round, so stepping and updating are independent and may run at the
//! same time. Whether they do changes only the speed.

use super::{Buffers, TrainError, Trainer};
use crate::{droq::Losses, replay::Transition};

impl Trainer {
    pub(super) fn round(&mut self) -> Result<(), TrainError> {
        self.act();
        let learning = self.step >= self.config.warmup_steps;
        let updates = if learning { self.config.updates_per_round } else { 0 };
        let held = self.critics_learn_alone();
        self.droq.hold_actor(held);
        let (droq, replay, sums) = (&mut self.droq, &self.replay, &mut self.sums);
        let mut learn = move || -> Result<(), Losses> {
            for _ in 0..updates {
                let losses = droq.learn(replay, true);
                if !(losses.critic + losses.actor + losses.temperature).is_finite() {
                    return Err(losses);
                }
                sums.add_update(&losses);
            }
            Ok(())
        };
        let Buffers { observation, action, batch, .. } = &mut self.buffers;
        let environment = &mut self.parts.environment;
        let mut step = || environment.step(action, batch);
        let learned = if updates == 0 || !self.config.overlap {
            step();
            learn()
        } else {
            rayon::join(learn, step).0
        };
        if let Err(losses) = learned {
            return Err(TrainError::NotFinite { what: format!("a loss ({losses:?})"), step: self.step });
        }

        let layout = environment.layout();
        let (len, action_len) = (layout.len(), environment.action_len());
        let given = batch
            .next_observation
            .iter()
            .chain(&batch.observation)
            .chain(&batch.reward)
            .chain(&batch.reward_terms);
        if !given.copied().all(f32::is_finite) {
            let what = "an observation or a reward of the environment (unstable physics?)".to_owned();
            return Err(TrainError::NotFinite { what, step: self.step });
        }
        for index in 0..self.config.num_envs {
            let observations = index * len..(index + 1) * len;
            self.replay.push(Transition {
                observation: &observation[observations.clone()],
                action: &action[index * action_len..(index + 1) * action_len],
                reward: batch.reward[index],
                terminal: batch.terminal[index],
                ends: batch.terminal[index] || batch.truncated[index],
                next_observation: &batch.next_observation[observations],
            });
        }
        self.sums.add_step(batch);
        observation.copy_from_slice(&batch.observation);
        self.step += self.config.num_envs as u64;
        Ok(())
    }

    /// Chooses the round's actions: uniformly random during the warm-up, except after a warm start, then from the policy.
    fn act(&mut self) {
        let at_random = self.acts_at_random();
        let Buffers { observation, action, noise, .. } = &mut self.buffers;
        if at_random {
            action.fill_with(|| 2.0 * self.warmup_stream.uniform() - 1.0);
        } else {
            self.policy_stream.fill_normal(noise);
            let bounds = self.droq_config.log_std_bounds;
            self.acting.explore(self.droq.actor_parameters(), observation, noise, bounds, action);
        }
    }
}
