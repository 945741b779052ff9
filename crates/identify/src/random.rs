//! Random draws of one batch, seeded by the fit's seed and the batch's number, so that no generator
//! has to be saved.

use rand::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// The draws of one batch.
pub(crate) struct Draws(Pcg64);

impl Draws {
    pub(crate) fn new(seed: u64, batch: u64) -> Self {
        // Two odd multipliers (from the golden ratio and from SplitMix64), so that consecutive
        // seeds and batches differ.
        let mixed = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ batch.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mut generator = Pcg64::seed_from_u64(mixed ^ seed.rotate_left(32));
        generator.next_u64();
        Self(generator)
    }

    /// Uniform in (0, 1), 53 bits.
    pub(crate) fn uniform(&mut self) -> f64 {
        ((self.0.next_u64() >> 12) as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
    }

    /// Uniform in 0..`bound` (`bound` at least one).
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        ((u128::from(self.0.next_u64()) * bound as u128) >> 64) as usize
    }
}
