//! CMA-ES: a normal distribution that learns the shape of the valley from the ranks of its samples.
//!
//! Constants and updates are those of Hansen's tutorial (arXiv:1604.00772, with negative weights) and the
//! restarts those of IPOP (Auger and Hansen 2005). Outside the cube the cost is that of the mirrored point,
//! so that a bound is a place like any other and the distribution needs no repair.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::{Deserialize, Serialize};

use crate::config::CmaConfig;
use crate::fit::{Method, Outcome, Reason};
use crate::problem::Problem;
use crate::random::Draws;

/// Generations in a row without a single sample that could be evaluated, after which the search gives up.
const MOST_FAILED_GENERATIONS: u32 = 10;
/// Ratio of the longest to the shortest axis, squared, beyond which sampling is no longer exact.
const LARGEST_CONDITION: f64 = 1e14;
/// Candidates of a generation at the most, however often the population was doubled.
const MOST_CANDIDATES: usize = 1_000_000;
/// The most rounds of the eigenvalue decomposition.
const EIGEN_ROUNDS: usize = 10_000;

/// State of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Cma {
    config: CmaConfig,
    seed: u64,
    /// Generations since the fit began.
    batch: u64,
    /// Candidates a generation.
    population: usize,
    restarts_left: u32,
    failed_generations: u32,
    search: Search,
}

/// The distribution and its history since the last restart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Search {
    generation: u64,
    mean: Vec<f64>,
    spread: f64,
    /// Shape, row by row; the distribution's covariance is `spread² · shape`.
    shape: Vec<f64>,
    path_of_spread: Vec<f64>,
    path_of_shape: Vec<f64>,
    /// Lowest cost of each of the last generations.
    recent: Vec<f64>,
}

impl Search {
    fn new(mean: Vec<f64>, spread: f64) -> Self {
        let n = mean.len();
        let shape = DMatrix::<f64>::identity(n, n).as_slice().to_vec();
        let (path_of_spread, path_of_shape) = (vec![0.0; n], vec![0.0; n]);
        Self { generation: 0, mean, spread, shape, path_of_spread, path_of_shape, recent: Vec::new() }
    }
}

/// What follows from the numbers of parameters and of samples (tutorial, table 1).
struct Constants {
    /// One a rank; those of the worse half are negative.
    weights: Vec<f64>,
    parents: usize,
    effective: f64,
    spread_rate: f64,
    spread_damping: f64,
    path_rate: f64,
    rank_one: f64,
    rank_mu: f64,
    /// Expected length of a standard normal vector.
    length: f64,
}

impl Constants {
    fn new(parameters: usize, population: usize) -> Self {
        let (n, parents) = (parameters as f64, population / 2);
        let raw: Vec<f64> = (1..=population)
            .map(|rank| (0.5 * (population as f64 + 1.0)).ln() - (rank as f64).ln())
            .collect();
        let effective_of = |weights: &[f64]| {
            let (sum, squares) = weights.iter().fold((0.0, 0.0), |(s, q), w| (s + w, q + w * w));
            sum * sum / squares
        };
        let effective = effective_of(&raw[..parents]);
        let effective_worse = effective_of(&raw[parents..]);
        let spread_rate = (effective + 2.0) / (n + effective + 5.0);
        let spread_damping =
            1.0 + 2.0 * (((effective - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + spread_rate;
        let path_rate = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n);
        let rank_one = 2.0 / ((n + 1.3).powi(2) + effective);
        let rank_mu = (1.0 - rank_one)
            .min(2.0 * (0.25 + effective + 1.0 / effective - 2.0) / ((n + 2.0).powi(2) + effective));
        let better: f64 = raw.iter().filter(|w| **w > 0.0).sum();
        let worse: f64 = -raw.iter().filter(|w| **w < 0.0).sum::<f64>();
        let negative = (1.0 + rank_one / rank_mu)
            .min(1.0 + 2.0 * effective_worse / (effective + 2.0))
            .min((1.0 - rank_one - rank_mu) / (n * rank_mu));
        let weights = raw.iter().map(|w| if *w > 0.0 { w / better } else { negative * w / worse }).collect();
        let length = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));
        Self {
            weights,
            parents,
            effective,
            spread_rate,
            spread_damping,
            path_rate,
            rank_one,
            rank_mu,
            length,
        }
    }
}

/// Axes of the distribution: directions as columns, and the standard deviation along each.
struct Axes {
    directions: DMatrix<f64>,
    lengths: DVector<f64>,
}

impl Axes {
    /// `None` where the shape has no axes any more: a length that is zero or not a number.
    fn of(shape: &[f64], n: usize) -> Option<Self> {
        let eigen =
            SymmetricEigen::try_new(DMatrix::from_row_slice(n, n, shape), f64::EPSILON, EIGEN_ROUNDS)?;
        let sound = eigen.eigenvalues.iter().all(|value| *value > 0.0 && value.is_finite());
        let (lengths, directions) = (eigen.eigenvalues.map(f64::sqrt), eigen.eigenvectors);
        sound.then_some(Self { directions, lengths })
    }

    /// `shape^(-1/2) · step`.
    fn whitened(&self, step: &DVector<f64>) -> DVector<f64> {
        &self.directions * self.directions.tr_mul(step).component_div(&self.lengths)
    }
}

impl Cma {
    pub(crate) fn new(problem: &Problem, config: CmaConfig, seed: u64) -> Self {
        let n = problem.space().len();
        let standard = 4 + (3.0 * (n as f64).ln()).floor() as usize;
        Self {
            population: if config.population == 0 { standard } else { config.population },
            restarts_left: config.restarts,
            failed_generations: 0,
            seed,
            batch: 0,
            search: Search::new(problem.space().start(), config.initial_spread),
            config,
        }
    }

    /// The steps of this generation, in units of the spread, not mirrored and not widened.
    fn steps(&self) -> Vec<DVector<f64>> {
        let n = self.search.mean.len();
        let Some(axes) = Axes::of(&self.search.shape, n) else { return Vec::new() };
        let mut draws = Draws::new(self.seed, self.batch);
        let mut step = || {
            let normal = DVector::from_fn(n, |_, _| draws.normal());
            &axes.directions * normal.component_mul(&axes.lengths)
        };
        (0..self.population).map(|_| step()).collect()
    }

    /// Moves the distribution to where the better of its samples were.
    fn adapt(&mut self, order: &[usize], steps: &[DVector<f64>]) {
        let search = &mut self.search;
        let n = search.mean.len();
        let constants = Constants::new(n, self.population);
        let Some(axes) = Axes::of(&search.shape, n) else { return };
        let mut shift = DVector::zeros(n);
        for (&sample, &weight) in order.iter().zip(&constants.weights).take(constants.parents) {
            shift.axpy(weight, &steps[sample], 1.0);
        }
        for (mean, by) in search.mean.iter_mut().zip(shift.iter()) {
            // Two periods of the mirrored cube, so that it cannot wander out of the reach of numbers.
            *mean = (*mean + search.spread * by) % 2.0;
        }
        let (rate, effective) = (constants.spread_rate, constants.effective);
        let mut path = DVector::from_column_slice(&search.path_of_spread);
        path = path * (1.0 - rate) + axes.whitened(&shift) * (rate * (2.0 - rate) * effective).sqrt();
        let relative = path.norm() / constants.length;
        search.spread *= (rate / constants.spread_damping * (relative - 1.0)).exp().min(2.0);
        search.spread = search.spread.clamp(1e-15, 1e3);
        search.generation += 1;
        let age = 1.0 - (1.0 - rate).powf(2.0 * search.generation as f64);
        // While the spread grows fast, the path of the shape waits.
        let waits = relative / age.sqrt() >= 1.4 + 2.0 / (n as f64 + 1.0);
        let rate = constants.path_rate;
        let mut path_of_shape = DVector::from_column_slice(&search.path_of_shape) * (1.0 - rate);
        if !waits {
            path_of_shape.axpy((rate * (2.0 - rate) * effective).sqrt(), &shift, 1.0);
        }
        let lost = if waits { constants.rank_one * rate * (2.0 - rate) } else { 0.0 };
        let total: f64 = constants.weights.iter().sum();
        let mut shape = DMatrix::from_row_slice(n, n, &search.shape);
        shape *= 1.0 + lost - constants.rank_one - constants.rank_mu * total;
        shape.ger(constants.rank_one, &path_of_shape, &path_of_shape, 1.0);
        for (&sample, &weight) in order.iter().zip(&constants.weights) {
            let step = &steps[sample];
            // A bad sample far out must not turn the shape inside out.
            let tamed =
                if weight < 0.0 { n as f64 / axes.whitened(step).norm_squared().max(1e-300) } else { 1.0 };
            shape.ger(constants.rank_mu * weight * tamed, step, step, 1.0);
        }
        // Rounding must not make it lopsided.
        let even = DMatrix::from_fn(n, n, |i, j| 0.5 * (shape[(i, j)] + shape[(j, i)]));
        search.shape.copy_from_slice(even.as_slice());
        search.path_of_spread.copy_from_slice(path.as_slice());
        search.path_of_shape.copy_from_slice(path_of_shape.as_slice());
    }

    /// Why this search is over, if it is.
    fn settled(&self) -> Option<Reason> {
        let search = &self.search;
        let n = search.mean.len();
        let Some(axes) = Axes::of(&search.shape, n) else { return Some(Reason::Spread) };
        let narrow = (0..n).all(|i| {
            let deviation = search.shape[i * n + i].sqrt().max(search.path_of_shape[i].abs());
            search.spread * deviation < self.config.spread_tolerance
        });
        let (longest, shortest) = (axes.lengths.max(), axes.lengths.min());
        if narrow || (longest / shortest).powi(2) > LARGEST_CONDITION {
            return Some(Reason::Spread);
        }
        let (low, high) = search
            .recent
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(*c), high.max(*c)));
        let flat =
            search.recent.len() >= self.memory() && high - low <= self.config.cost_tolerance * low.abs();
        flat.then_some(Reason::Cost)
    }

    /// Generations over which a settled search must not have changed (tutorial, appendix B.3).
    fn memory(&self) -> usize {
        10 + (30 * self.search.mean.len()).div_ceil(self.population)
    }

    fn restart(&mut self, reason: Reason) -> Option<Reason> {
        let Some(left) = self.restarts_left.checked_sub(1) else { return Some(reason) };
        self.restarts_left = left;
        self.population = (2 * self.population).min(MOST_CANDIDATES);
        let mut draws = Draws::new(!self.seed, self.batch);
        let mean = (0..self.search.mean.len()).map(|_| draws.uniform()).collect();
        self.search = Search::new(mean, self.config.initial_spread);
        None
    }
}

/// Coordinate of the cube that a coordinate anywhere stands for: the cube is mirrored at its sides, again and
/// again.
fn mirrored(coordinate: f64) -> f64 {
    let within = coordinate.rem_euclid(2.0);
    if within > 1.0 { 2.0 - within } else { within }
}

impl Method for Cma {
    fn propose(&self, _problem: &Problem) -> Vec<Vec<f64>> {
        let search = &self.search;
        let place = |step: DVector<f64>| {
            search.mean.iter().zip(&step).map(|(mean, step)| mirrored(mean + search.spread * step)).collect()
        };
        self.steps().into_iter().map(place).collect()
    }

    fn learn(
        &mut self,
        _problem: &Problem,
        _points: &[Vec<f64>],
        outcomes: &[Option<Outcome<'_>>],
    ) -> Option<Reason> {
        let steps = self.steps();
        self.batch += 1;
        let cost = |sample: usize| outcomes[sample].as_ref().map_or(f64::INFINITY, |outcome| outcome.cost);
        let mut order: Vec<usize> = (0..outcomes.len().min(steps.len())).collect();
        order.sort_by(|&a, &b| cost(a).total_cmp(&cost(b)));
        let lowest = order.first().map_or(f64::INFINITY, |&sample| cost(sample));
        if lowest == f64::INFINITY {
            self.failed_generations += 1;
            self.search.spread *= 0.5;
            let over = steps.is_empty() || self.failed_generations >= MOST_FAILED_GENERATIONS;
            return if over { self.restart(Reason::Failures) } else { None };
        }
        self.failed_generations = 0;
        self.adapt(&order, &steps);
        let memory = self.memory();
        let recent = &mut self.search.recent;
        recent.push(lowest);
        if recent.len() > memory {
            recent.remove(0);
        }
        match self.settled() {
            Some(reason) => self.restart(reason),
            None => None,
        }
    }

    fn is_sound(&self, problem: &Problem) -> bool {
        let (n, s) = (problem.space().len(), &self.search);
        let vectors = [&s.mean, &s.path_of_spread, &s.path_of_shape];
        let lengths = vectors.iter().all(|v| v.len() == n) && Some(s.shape.len()) == n.checked_mul(n);
        let finite = vectors.iter().chain([&&s.shape, &&s.recent]).all(|v| v.iter().all(|x| x.is_finite()));
        let settings = self.config.validate().is_ok() && (4..=MOST_CANDIDATES).contains(&self.population);
        lengths && finite && settings && s.spread > 0.0 && s.spread.is_finite()
    }
}
