//! Bayesian optimisation, the paper's method: a Gaussian process through all evaluations, and the
//! candidates with the greatest expected improvement.
//!
//! The evaluated points are the whole state: each batch fits a new process to them, with a seed
//! that depends on the batch. The process models the logarithm of one plus the cost, because costs
//! span orders of magnitude.

use rand::seq::SliceRandom as _;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::gaussian_process::GaussianProcess;
use crate::method::{Outcome, StopReason};
use crate::problem::Problem;
use crate::space::all_inside;

/// Random points a coordinate among which the search for the next candidate begins.
const RANDOM_POINTS: usize = 100;
/// Half widths of boxes about the best point in which it begins too, in normalised coordinates.
const LOCAL_RADII: [f64; 3] = [0.2, 0.05, 0.01];
/// How many of the best ones are refined.
const REFINED: usize = 4;
/// Points closer than this, in normalised coordinates, add no information to a process and make its
/// matrices ill-conditioned.
const SAME_POINT: f64 = 1e-6;

/// State of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Bo {
    seed: u64,
    batch: u64,
    /// Points and their costs; `None` for a failure.
    evaluated: Vec<(Vec<f64>, Option<f64>)>,
}

impl Bo {
    pub(crate) fn new(seed: u64) -> Self {
        Self { seed, batch: 0, evaluated: Vec::new() }
    }

    pub(crate) fn propose(&self, problem: &Problem) -> Vec<Vec<f64>> {
        if self.evaluated.is_empty() {
            return self.initial(problem);
        }
        let n = problem.space().len();
        let mut draws = self.draws();
        let mut point = self.suggested(n, &mut draws).unwrap_or_else(|| random_point(n, &mut draws));
        // A known point is replaced by a random one, with a limit on the attempts.
        for _ in 0..20 {
            if !self.is_known(&point) {
                break;
            }
            point = random_point(n, &mut draws);
        }
        vec![point]
    }

    pub(crate) fn update(
        &mut self,
        points: &[Vec<f64>],
        outcomes: &[Option<Outcome<'_>>],
    ) -> Option<StopReason> {
        for (point, outcome) in points.iter().zip(outcomes) {
            self.evaluated.push((all_inside(point), outcome.as_ref().map(|outcome| outcome.cost)));
        }
        self.batch += 1;
        let none = self.evaluated.iter().all(|(_, cost)| cost.is_none());
        (none && self.batch > 1).then_some(StopReason::Failures)
    }

    /// The start, and a Latin hypercube: each parameter's range in as many stripes as candidates,
    /// one in each.
    fn initial(&self, problem: &Problem) -> Vec<Vec<f64>> {
        let n = problem.space().len();
        let stripes = 2 * n + 1;
        let mut draws = self.draws();
        let mut points = vec![vec![0.0; n]; stripes];
        for parameter in 0..n {
            let mut order: Vec<usize> = (0..stripes).collect();
            order.shuffle(&mut draws);
            for (point, stripe) in points.iter_mut().zip(order) {
                point[parameter] = (stripe as f64 + draws.random::<f64>()) / stripes as f64;
            }
        }
        std::iter::once(problem.space().start()).chain(points).collect()
    }

    /// The candidate of the process; `None` where it cannot be fitted.
    fn suggested(&self, n: usize, draws: &mut Pcg64) -> Option<Vec<f64>> {
        let heights: Vec<Option<f64>> = self.evaluated.iter().map(|(_, cost)| cost.map(f64::ln_1p)).collect();
        // A failure counts as the worst cost.
        let worst = heights.iter().flatten().copied().reduce(f64::max)?;
        let heights: Vec<f64> = heights.into_iter().map(|height| height.unwrap_or(worst)).collect();
        let points: Vec<Vec<f64>> = self.evaluated.iter().map(|(point, _)| point.clone()).collect();
        let process = GaussianProcess::fit(&points, &heights)?;
        let (best, least) = points.iter().zip(&heights).min_by(|a, b| a.1.total_cmp(b.1))?;
        search(&process, *least, best, n, draws)
    }

    /// The draws of a batch, which depend on the seed and the batch's number alone, so that no
    /// generator has to be saved.
    fn draws(&self) -> Pcg64 {
        Pcg64::seed_from_u64(self.seed ^ self.batch.rotate_left(32))
    }

    fn is_known(&self, point: &[f64]) -> bool {
        self.evaluated
            .iter()
            .any(|(known, _)| known.iter().zip(point).all(|(a, b)| (a - b).abs() < SAME_POINT))
    }
}

/// A uniformly random point.
fn random_point(n: usize, draws: &mut Pcg64) -> Vec<f64> {
    (0..n).map(|_| draws.random::<f64>()).collect()
}

/// The acquisition function: expected improvement on the least height less the predicted height
/// (Watson and Barnes 1995).
fn acquisition(process: &GaussianProcess, least: f64, point: &[f64]) -> f64 {
    let (mean, deviation) = process.predict(point);
    let gain = least - mean;
    if deviation < 1e-12 {
        return gain.max(0.0) - mean;
    }
    let z = gain / deviation;
    let density = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    gain * normal(z) + deviation * density - mean
}

/// The standard normal distribution to 1e-7 (Abramowitz and Stegun 26.2.17).
fn normal(z: f64) -> f64 {
    const B: [f64; 5] = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let tail = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    let upper = tail * B.iter().rev().fold(0.0, |sum, b| (sum + b) * t);
    if z >= 0.0 { 1.0 - upper } else { upper }
}

/// The best point of a search over the whole cube and near the best so far; the first few are
/// refined coordinate by coordinate.
fn search(
    process: &GaussianProcess,
    least: f64,
    best: &[f64],
    n: usize,
    draws: &mut Pcg64,
) -> Option<Vec<f64>> {
    let mut candidates: Vec<Vec<f64>> = (0..RANDOM_POINTS * n).map(|_| random_point(n, draws)).collect();
    for radius in LOCAL_RADII {
        for _ in 0..RANDOM_POINTS * n / 2 {
            let local = best.iter().map(|u| u + radius * (2.0 * draws.random::<f64>() - 1.0));
            candidates.push(local.map(|u| u.clamp(0.0, 1.0)).collect());
        }
    }
    let mut ranked: Vec<(f64, Vec<f64>)> =
        candidates.into_iter().map(|point| (acquisition(process, least, &point), point)).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    ranked.truncate(REFINED);
    for (value, point) in &mut ranked {
        let mut step = 0.05;
        while step > 1e-4 {
            let before = *value;
            for coordinate in 0..n {
                for change in [step, -step] {
                    let old = point[coordinate];
                    point[coordinate] = (old + change).clamp(0.0, 1.0);
                    let now = acquisition(process, least, point);
                    if now > *value {
                        *value = now;
                        break;
                    }
                    point[coordinate] = old;
                }
            }
            if *value <= before {
                step /= 2.0;
            }
        }
    }
    ranked.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, point)| point)
}
