//! Sums between two rows of metrics. They are saved in checkpoints, so that a resumed training
//! writes the same rows.

use crate::{droq::Losses, env::StepBatch};

/// Sums since the last row, and the running episodes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sums {
    steps: f64,
    reward: f64,
    terms: Vec<f64>,
    updates: f64,
    losses: [f64; 5],
    /// Of the episodes that ended: count, total return, total length.
    episodes: [f64; 3],
    /// Return and length so far, by environment.
    running: Vec<[f64; 2]>,
}

impl Sums {
    pub(crate) fn new(num_envs: usize, terms: usize) -> Self {
        Self {
            steps: 0.0,
            reward: 0.0,
            terms: vec![0.0; terms],
            updates: 0.0,
            losses: [0.0; 5],
            episodes: [0.0; 3],
            running: vec![[0.0; 2]; num_envs],
        }
    }

    pub(crate) fn add_update(&mut self, losses: &Losses) {
        let Losses { critic, actor, temperature, entropy, q_mean } = *losses;
        self.updates += 1.0;
        for (sum, value) in self.losses.iter_mut().zip([critic, actor, temperature, entropy, q_mean]) {
            *sum += value;
        }
    }

    pub(crate) fn add_step(&mut self, batch: &StepBatch) {
        self.steps += batch.reward.len() as f64;
        if !self.terms.is_empty() {
            for row in batch.reward_terms.chunks_exact(self.terms.len()) {
                for (sum, &value) in self.terms.iter_mut().zip(row) {
                    *sum += f64::from(value);
                }
            }
        }
        for (index, running) in self.running.iter_mut().enumerate() {
            let reward = f64::from(batch.reward[index]);
            self.reward += reward;
            running[0] += reward;
            running[1] += 1.0;
            if batch.truncated[index] {
                self.episodes[0] += 1.0;
                self.episodes[1] += running[0];
                self.episodes[2] += running[1];
                *running = [0.0; 2];
            }
        }
    }

    /// Returns the named means since the last row, and resets the sums.
    pub(crate) fn take(&mut self, term_names: &[String]) -> Vec<(String, f64)> {
        let mut values = vec![("charts/reward_per_step".to_owned(), self.reward / self.steps)];
        let [count, total, length] = self.episodes;
        if count > 0.0 {
            values.push(("charts/episodic_return".to_owned(), total / count));
            values.push(("charts/episodic_length".to_owned(), length / count));
        }
        for (name, sum) in term_names.iter().zip(&self.terms) {
            values.push((format!("reward/{name}"), sum / self.steps));
        }
        if self.updates > 0.0 {
            let names =
                ["losses/critic", "losses/actor", "losses/temperature", "charts/entropy", "charts/q_mean"];
            for (name, sum) in names.into_iter().zip(self.losses) {
                values.push((name.to_owned(), sum / self.updates));
            }
        }
        let running = std::mem::take(&mut self.running);
        *self = Self { running, ..Self::new(0, self.terms.len()) };
        values
    }

    /// Every number, in the order in which they are saved.
    fn slots(&mut self) -> impl Iterator<Item = &mut f64> {
        let counts = [&mut self.steps, &mut self.reward, &mut self.updates].into_iter();
        let since = counts.chain(&mut self.terms).chain(&mut self.losses).chain(&mut self.episodes);
        since.chain(self.running.as_flattened_mut())
    }

    pub(crate) fn to_values(&self) -> Vec<f64> {
        self.clone().slots().map(|value| *value).collect()
    }

    /// Restores saved sums; returns false if their number is wrong.
    pub(crate) fn set_values(&mut self, values: &[f64]) -> bool {
        let fits = values.len() == self.slots().count();
        if fits {
            self.slots().zip(values).for_each(|(slot, value)| *slot = *value);
        }
        fits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::env::ObservationLayout;

    #[test]
    fn means_are_per_step_and_state_survives() {
        let mut batch = StepBatch::new(2, ObservationLayout { real: 1, binary: 0 }, 2);
        batch.reward = vec![1.0, 3.0];
        batch.reward_terms = vec![1.0, 0.0, 1.0, 2.0];
        batch.truncated = vec![false, true];
        let mut sums = Sums::new(2, 2);
        sums.add_step(&batch);
        sums.add_step(&batch);
        sums.add_update(&Losses { critic: 2.0, ..Default::default() });
        sums.add_update(&Losses { critic: 4.0, ..Default::default() });
        let mut copy = Sums::new(2, 2);
        assert!(copy.set_values(&sums.to_values()) && !copy.set_values(&[1.0]));
        assert_eq!(copy, sums);
        let values = sums.take(&["a".to_owned(), "b".to_owned()]);
        let get = |name: &str| values.iter().find(|(key, _)| key == name).unwrap().1;
        assert_eq!(get("charts/reward_per_step"), 2.0);
        assert_eq!(get("charts/episodic_return"), 3.0);
        assert_eq!(get("reward/a"), 1.0);
        assert_eq!(get("reward/b"), 1.0);
        assert_eq!(get("losses/critic"), 3.0);
        // The episode of the first environment continues.
        assert_eq!(sums.to_values().iter().sum::<f64>(), 4.0);
    }
}
