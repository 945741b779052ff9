//! A random stream: PCG-64 seeded from the root seed and a purpose. Its state is saved in
//! checkpoints.

use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::seed;

/// The random stream of one purpose.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Pcg64", into = "Pcg64")]
pub(crate) struct Stream(Pcg64);

impl From<Stream> for Pcg64 {
    fn from(stream: Stream) -> Self {
        stream.0
    }
}

impl TryFrom<Pcg64> for Stream {
    type Error = &'static str;

    /// Refuses a state that always gives the same number, with which drawing a normal value may
    /// never end.
    fn try_from(generator: Pcg64) -> Result<Self, Self::Error> {
        let mut copy = generator.clone();
        let first = copy.next_u64();
        let alive = (0..3).any(|_| copy.next_u64() != first);
        if alive { Ok(Self(generator)) } else { Err("a generator that always draws the same") }
    }
}

impl Stream {
    pub(crate) fn new(root: u64, purpose: &str) -> Self {
        Self(Pcg64::seed_from_u64(seed::split(root, purpose)))
    }

    /// Uniform in [0, 1), 24 bits.
    pub(crate) fn uniform(&mut self) -> f32 {
        (self.0.next_u64() >> 40) as f32 * (1.0 / (1u64 << 24) as f32)
    }

    /// Uniform in 0..`bound`, by multiplication (Lemire 2019); the bias is below `bound` / 2⁶⁴.
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        ((u128::from(self.0.next_u64()) * bound as u128) >> 64) as usize
    }

    /// Fills with standard normal values.
    pub(crate) fn fill_normal(&mut self, values: &mut [f32]) {
        values.fill_with(|| StandardNormal.sample(&mut self.0));
    }

    /// Replaces `drops` with the positions in 0..`len` of units that are each dropped with
    /// probability `rate`.
    ///
    /// Draws the gap to the next dropped unit, which is geometrically distributed, instead of one
    /// number a unit.
    pub(crate) fn fill_drops(&mut self, rate: f64, len: usize, drops: &mut Vec<u32>) {
        drops.clear();
        if rate <= 0.0 {
            return;
        }
        let scale = 1.0 / (-rate).ln_1p();
        let mut position = 0usize;
        loop {
            // (0, 1], so that the logarithm is finite.
            let uniform = ((self.0.next_u64() >> 11) + 1) as f64 * (1.0 / (1u64 << 53) as f64);
            let gap = uniform.ln() * scale;
            if gap >= (len - position) as f64 {
                return;
            }
            position += gap as usize;
            drops.push(position as u32);
            position += 1;
            if position == len {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_are_bernoulli() {
        let mut stream = Stream::new(3, "test");
        let (len, rounds, rate) = (1000usize, 2000usize, 0.05);
        let mut hits = vec![0u32; len];
        let mut neighbours = 0u32;
        let mut drops = Vec::new();
        for _ in 0..rounds {
            stream.fill_drops(rate, len, &mut drops);
            assert!(
                drops.windows(2).all(|pair| pair[0] < pair[1]) && drops.iter().all(|&d| (d as usize) < len)
            );
            neighbours += drops.windows(2).filter(|pair| pair[1] == pair[0] + 1).count() as u32;
            for &drop in &drops {
                hits[drop as usize] += 1;
            }
        }
        let expected = rate * rounds as f64;
        let total: u32 = hits.iter().sum();
        assert!((f64::from(total) / (len as f64 * expected) - 1.0).abs() < 0.02);
        // Neither the first nor the last position is favoured, and neighbours are independent.
        for edge in [0, 1, len - 1] {
            assert!((f64::from(hits[edge]) - expected).abs() < 5.0 * expected.sqrt());
        }
        let pairs = (len - 1) as f64 * rounds as f64 * rate * rate;
        assert!((f64::from(neighbours) / pairs - 1.0).abs() < 0.1);
        stream.fill_drops(0.0, len, &mut drops);
        assert!(drops.is_empty());
    }

    #[test]
    fn a_stuck_generator_is_refused() {
        let text = serde_json::to_string(&Stream::new(1, "a")).unwrap();
        assert!(text.contains("state") && text.contains("increment"), "{text}");
        assert!(serde_json::from_str::<Stream>(r#"{"state":0,"increment":0}"#).is_err());
    }

    #[test]
    fn state_survives_text() {
        let mut stream = Stream::new(u64::MAX, "a");
        stream.uniform();
        let text = serde_json::to_string(&stream).unwrap();
        let mut copy: Stream = serde_json::from_str(&text).unwrap();
        assert_eq!(copy, stream);
        assert_eq!(copy.below(1000), stream.below(1000));
    }

    #[test]
    fn uniform_and_normal_have_their_moments() {
        let mut stream = Stream::new(5, "moments");
        let mean = (0..100_000).map(|_| f64::from(stream.uniform())).sum::<f64>() / 1e5;
        assert!((mean - 0.5).abs() < 0.005);
        let mut values = vec![0.0; 100_000];
        stream.fill_normal(&mut values);
        let (sum, square) =
            values.iter().fold((0.0, 0.0), |(s, q), &x| (s + f64::from(x), q + f64::from(x * x)));
        assert!((sum / 1e5).abs() < 0.02 && (square / 1e5 - 1.0).abs() < 0.02);
    }
}
