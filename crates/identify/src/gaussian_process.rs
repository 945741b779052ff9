//! A Gaussian process (Rasmussen and Williams 2006, chapters 2, 4 and 5): Matérn 5/2 with a length
//! a coordinate and a constant mean; the lengths maximise the likelihood.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Share of the variance that counts as noise, so that close points do not make the matrix
/// singular.
const NUGGET: f64 = 1e-6;
/// Shortest and longest length, in ranges of a coordinate.
const LENGTHS: [f64; 2] = [0.03, 10.0];
/// Factors of the search for the best lengths, one length at a time.
const FACTORS: [f64; 3] = [3.0, 1.7, 1.3];

/// A process through points of the unit cube.
pub(crate) struct GaussianProcess {
    points: Vec<Vec<f64>>,
    lengths: Vec<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Inverse correlation matrix times heights above the mean.
    weights: DVector<f64>,
    mean: f64,
    variance: f64,
    likelihood: f64,
}

fn correlation(a: &[f64], b: &[f64], lengths: &[f64]) -> f64 {
    let square: f64 = a.iter().zip(b).zip(lengths).map(|((a, b), length)| ((a - b) / length).powi(2)).sum();
    let r = (5.0 * square).sqrt();
    (1.0 + r + r * r / 3.0) * (-r).exp()
}

impl GaussianProcess {
    /// The process through these heights with these lengths; `None` where the matrix cannot be
    /// factored.
    fn with_lengths(points: &[Vec<f64>], heights: &[f64], lengths: &[f64]) -> Option<Self> {
        let n = points.len();
        let matrix = DMatrix::from_fn(n, n, |i, j| {
            correlation(&points[i], &points[j], lengths) + if i == j { NUGGET } else { 0.0 }
        });
        let factor = Cholesky::new(matrix)?;
        let heights = DVector::from_column_slice(heights);
        let ones = DVector::from_element(n, 1.0);
        let mean = factor.solve(&heights).sum() / factor.solve(&ones).sum();
        let above = heights.add_scalar(-mean);
        let weights = factor.solve(&above);
        let variance = (above.dot(&weights) / n as f64).max(f64::MIN_POSITIVE);
        let determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        let likelihood = -0.5 * n as f64 * variance.ln() - determinant;
        let (points, lengths) = (points.to_vec(), lengths.to_vec());
        likelihood.is_finite().then_some(Self {
            points,
            lengths,
            factor,
            weights,
            mean,
            variance,
            likelihood,
        })
    }

    /// The process through these heights with the best lengths found: first one for all
    /// coordinates, then one at a time.
    pub(crate) fn fit(points: &[Vec<f64>], heights: &[f64]) -> Option<Self> {
        let dimensions = points.first()?.len();
        let mut best: Option<Self> = None;
        let keep = |lengths: &[f64], best: &mut Option<Self>| {
            let found = Self::with_lengths(points, heights, lengths);
            let better = found.filter(|f| best.as_ref().is_none_or(|b| f.likelihood > b.likelihood));
            let is_better = better.is_some();
            *best = better.or(best.take());
            is_better
        };
        for length in [0.1, 0.2, 0.4, 0.8, 1.6, 3.2] {
            keep(&vec![length; dimensions], &mut best);
        }
        for factor in FACTORS {
            for coordinate in 0..dimensions {
                for factor in [factor, 1.0 / factor] {
                    let mut lengths = best.as_ref()?.lengths.clone();
                    lengths[coordinate] = (lengths[coordinate] * factor).clamp(LENGTHS[0], LENGTHS[1]);
                    if keep(&lengths, &mut best) {
                        break;
                    }
                }
            }
        }
        best
    }

    /// Expected height at a point and its standard deviation.
    pub(crate) fn predict(&self, point: &[f64]) -> (f64, f64) {
        let n = self.points.len();
        let near = DVector::from_fn(n, |i, _| correlation(point, &self.points[i], &self.lengths));
        let mean = self.mean + near.dot(&self.weights);
        // The known points reduce the variance. The mean's uncertainty is neglected.
        let known = self.factor.l_dirty().solve_lower_triangular(&near).map_or(0.0, |v| v.norm_squared());
        (mean, (self.variance * (1.0 + NUGGET - known)).max(0.0).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: usize) -> Vec<Vec<f64>> {
        (0..n * n).map(|i| vec![(i % n) as f64 / (n - 1) as f64, (i / n) as f64 / (n - 1) as f64]).collect()
    }

    #[test]
    fn it_passes_through_its_points_with_little_deviation() {
        let points = grid(4);
        let heights: Vec<f64> = points.iter().map(|p| (3.0 * p[0]).sin() + p[1] * p[1]).collect();
        let process = GaussianProcess::fit(&points, &heights).unwrap();
        for (point, height) in points.iter().zip(&heights) {
            let (mean, deviation) = process.predict(point);
            assert!((mean - height).abs() < 1e-3 && deviation < 0.02, "{mean} {height} {deviation}");
        }
        let (mean, deviation) = process.predict(&[0.5, 0.5]);
        let expected = 1.5f64.sin() + 0.25;
        assert!((mean - expected).abs() < 3.0 * deviation + 1e-3, "{mean} {expected} {deviation}");
    }

    #[test]
    fn a_coordinate_that_does_not_matter_gets_a_long_length() {
        let points = grid(6);
        let heights: Vec<f64> = points.iter().map(|p| (9.0 * p[0]).sin()).collect();
        let process = GaussianProcess::fit(&points, &heights).unwrap();
        assert!(process.lengths[1] > 5.0 * process.lengths[0], "{:?}", process.lengths);
    }
}
