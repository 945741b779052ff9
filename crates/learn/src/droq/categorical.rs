//! Critics that say how likely each of a row of values is, instead of one value (Bellemare et al. 2017, arXiv 1707.06887).
//!
//! A critic's head then has a logit for each of the bins, whose centres lie evenly on the configured range. `Q` is the mean of
//! the softmax. What the critics shall say is the target critic's distribution with every centre moved to
//! `reward + discount · (centre - temperature · log π)`, shared out between the two bins next to it.

use crate::kernels::exp_in_place;

/// The centres of the bins.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bins {
    pub len: usize,
    low: f32,
    width: f32,
}

impl Bins {
    pub(crate) fn new(len: usize, [low, high]: [f64; 2]) -> Self {
        Self { len, low: low as f32, width: ((high - low) / (len - 1) as f64) as f32 }
    }

    fn centre(self, bin: usize) -> f32 {
        self.low + self.width * bin as f32
    }

    /// Turns each row of logits into probabilities, and writes their means into `values`.
    pub(crate) fn softmax(self, logits: &mut [f32], values: &mut [f32]) {
        for (row, value) in logits.chunks_exact_mut(self.len).zip(values) {
            let most = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            row.iter_mut().for_each(|logit| *logit -= most);
            exp_in_place(row);
            let scale = 1.0 / row.iter().sum::<f32>();
            row.iter_mut().for_each(|weight| *weight *= scale);
            *value = row.iter().enumerate().map(|(bin, &weight)| weight * self.centre(bin)).sum();
        }
    }

    /// Writes into `out` the distribution `probabilities` of one row after `value → scale · value + shift`.
    pub(crate) fn project(self, probabilities: &[f32], scale: f32, shift: f32, out: &mut [f32]) {
        out.fill(0.0);
        let last = (self.len - 1) as f32;
        for (bin, &weight) in probabilities.iter().enumerate() {
            let place = ((scale * self.centre(bin) + shift - self.low) / self.width).clamp(0.0, last);
            let below = (place as usize).min(self.len - 2);
            let share = place - below as f32;
            out[below] += weight * (1.0 - share);
            out[below + 1] += weight * share;
        }
    }

    /// Writes `weight · ∂Q/∂logit` of one row into `out`.
    pub(crate) fn mean_gradient(self, probabilities: &[f32], value: f32, weight: f32, out: &mut [f32]) {
        for (bin, (out, &probability)) in out.iter_mut().zip(probabilities).enumerate() {
            *out = weight * probability * (self.centre(bin) - value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_projection_keeps_mass_and_mean() {
        let bins = Bins::new(21, [-2.0, 8.0]);
        let mut probabilities: Vec<f32> = (0..21).map(|bin| (bin as f32 * 0.9).sin()).collect();
        let mut value = [0.0];
        bins.softmax(&mut probabilities, &mut value);
        let mut moved = vec![0.0; 21];
        bins.project(&probabilities, 0.7, 1.1, &mut moved);
        let mean: f32 = moved.iter().enumerate().map(|(bin, &weight)| weight * bins.centre(bin)).sum();
        assert!((moved.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        assert!((mean - (0.7 * value[0] + 1.1)).abs() < 1e-4, "{mean} for {}", value[0]);
        bins.project(&probabilities, 1.0, 100.0, &mut moved);
        assert!((moved[20] - 1.0).abs() < 1e-5);
    }

    #[test]
    fn the_gradient_of_the_mean_is_its_finite_difference() {
        let bins = Bins::new(5, [-1.0, 3.0]);
        let logits = [0.3f32, -0.2, 0.9, 0.1, -1.0];
        let mean = |logits: [f32; 5]| {
            let (mut row, mut value) = (logits, [0.0]);
            bins.softmax(&mut row, &mut value);
            (row, value[0])
        };
        let (row, value) = mean(logits);
        let mut gradient = [0.0; 5];
        bins.mean_gradient(&row, value, 1.0, &mut gradient);
        for (bin, gradient) in gradient.into_iter().enumerate() {
            let (mut up, mut down) = (logits, logits);
            up[bin] += 1e-2;
            down[bin] -= 1e-2;
            assert!(((mean(up).1 - mean(down).1) / 2e-2 - gradient).abs() < 1e-3);
        }
    }
}
