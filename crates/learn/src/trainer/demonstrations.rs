//! Stretches of experience in which a demonstrator acts instead of the policy.
//!
//! Demonstrations are stored in the replay buffer like all experience, and the same updates learn from them (compare Ball et al. 2023,
//! "Efficient online reinforcement learning with offline data", arXiv 2302.02948). Demonstrator and policy alternate within episodes,
//! so that there are also demonstrations from states that the policy has reached.

use serde::{Deserialize, Serialize};

use crate::{config::TrainerConfig, random::Stream};

/// Control steps between draws of who acts: one second of music.
const STRETCH: u64 = 20;

/// Who acts in which environment. Part of the checkpoint.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Demonstrations {
    stream: Stream,
    /// For each environment, whether the demonstrator acts.
    shown: Vec<bool>,
}

impl Demonstrations {
    pub(crate) fn new(config: &TrainerConfig) -> Self {
        let stream = Stream::new(config.seed, "trainer/demonstrations");
        Self { stream, shown: vec![false; config.num_envs] }
    }

    pub(crate) fn num_envs(&self) -> usize {
        self.shown.len()
    }

    /// Puts `demonstrated` actions with noise over those of `actions` (`[n, action]` both) in which the demonstrator
    /// acts in this `round` of the training.
    pub(crate) fn mix(
        &mut self,
        config: &TrainerConfig,
        round: u64,
        demonstrated: &[f32],
        actions: &mut [f32],
    ) {
        let (count, len) = (self.shown.len() as u64, actions.len() / self.shown.len());
        let rows = demonstrated.chunks_exact(len).zip(actions.chunks_exact_mut(len));
        for ((index, shown), (demonstrated, actions)) in (0..).zip(&mut self.shown).zip(rows) {
            // The environments draw one after the other and not all at once.
            if round == 0 || (round + index * STRETCH / count).is_multiple_of(STRETCH) {
                *shown = f64::from(self.stream.uniform()) < config.demonstration_share;
            }
            if *shown {
                self.stream.fill_normal(actions);
                for (action, &demonstrated) in actions.iter_mut().zip(demonstrated) {
                    *action = (demonstrated + config.demonstration_noise as f32 * *action).clamp(-1.0, 1.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_demonstrator_acts_its_share_in_stretches() {
        let config = TrainerConfig {
            num_envs: 8,
            demonstration_share: 0.3,
            demonstration_noise: 0.1,
            ..Default::default()
        };
        let mut demonstrations = Demonstrations::new(&config);
        let (mut shown, mut changes, mut before) = (0, 0, [false; 8]);
        let (mut sum, mut squares) = (0.0, 0.0);
        let rounds = 20_000;
        for round in 0..rounds {
            let mut actions = [-0.5; 16];
            demonstrations.mix(&config, round, &[0.5; 16], &mut actions);
            for (row, before) in actions.chunks(2).zip(&mut before) {
                let demonstrated = row != [-0.5; 2];
                changes += u32::from(demonstrated != *before);
                *before = demonstrated;
                if demonstrated {
                    shown += 1;
                    sum += row[0] - 0.5;
                    squares += (row[0] - 0.5) * (row[0] - 0.5);
                }
            }
        }
        let share = f64::from(shown) / (8 * rounds) as f64;
        assert!((share - 0.3).abs() < 0.02, "{share}");
        // Two stretches in a row differ in who acts with probability 2 * 0.3 * 0.7.
        let expected = 8.0 * (rounds / STRETCH) as f64 * 0.42;
        assert!((f64::from(changes) / expected - 1.0).abs() < 0.1, "{changes} of {expected}");
        let (mean, deviation) = (sum / shown as f32, (squares / shown as f32).sqrt());
        assert!(mean.abs() < 0.01 && (deviation - 0.1).abs() < 0.01, "{mean} {deviation}");
    }
}
