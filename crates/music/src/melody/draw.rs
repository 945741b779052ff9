//! Random draws. They use the generator's raw words alone, so that a melody stays the same when a
//! library changes how it draws.

use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// A stream of draws.
pub(super) struct Draw(Pcg64);

impl Draw {
    pub(super) fn new(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }

    /// Uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform from `low` to `high`.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// From `low` to `high`, both above zero; the logarithm is uniform.
    pub(super) fn log_between(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    /// Uniform in `low..=high`.
    pub(super) fn whole(&mut self, low: usize, high: usize) -> usize {
        low + (self.unit() * (high + 1 - low) as f64) as usize
    }

    /// True with this probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// An index, each as probable as its weight; none if no weight is above zero.
    pub(super) fn weighted(&mut self, weights: &[f64]) -> Option<usize> {
        let sum: f64 = weights.iter().sum();
        let mut left = self.unit() * sum;
        let usable = |index: &usize| weights[*index] > 0.0;
        let found = (0..weights.len()).filter(usable).find(|index| {
            left -= weights[*index];
            left < 0.0
        });
        // Rounding may leave a little of the sum.
        found.or_else(|| (0..weights.len()).rfind(usable))
    }
}
