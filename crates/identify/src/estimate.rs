//! The uncertainty of an estimate: intervals, correlations, and what is not identifiable.
//!
//! All of it is linear theory at the optimum: with the Jacobian J of the residuals, the covariance
//! of the parameters is the sandwich `A⁻¹ M A⁻¹` with `A = JᵀJ` and `M = Σ τ s² JᵀJ` summed over
//! the blocks, s² being a block's residual variance and τ its integrated autocorrelation time
//! ([`integrated_autocorrelation`]): correlated residuals count as `samples / τ`. With one block of
//! white residuals that is `s² (JᵀJ)⁻¹`. Under the Huber loss, residuals beyond its bend do not
//! count in A and count as the bend in s² (Huber 1981). The correction takes the slopes to be as
//! slow as the residuals, so where they are faster the intervals are too wide, not too narrow.

use std::ops::Range;

use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

use crate::autocorrelation::integrated_autocorrelation;
use crate::error::FitError;
use crate::jacobian::Linearisation;
use crate::problem::{Block, Problem};

/// Half a 95 % interval, in standard errors.
pub(crate) const HALF_INTERVAL: f64 = 1.959_963_984_540_054;
/// A direction is weak when half its 95 % interval is longer than this share of the parameters'
/// ranges, ...
pub(crate) const WEAK_HALF_INTERVAL: f64 = 0.5;
/// ... or when its singular value is a smaller share of the largest (our choice).
const WEAK_SHARE: f64 = 1e-6;
/// Singular values smaller than this share of the largest are rounding.
const MIN_SINGULAR_SHARE: f64 = 3e-8;
/// A parameter takes part in a direction from this component of its unit vector on.
const MIN_COMPONENT: f64 = 0.3;
/// Shorter blocks share one variance, without autocorrelation.
const SHORT_BLOCK: usize = 32;
/// How close to a bound is at it, in normalised coordinates.
const AT_BOUND: f64 = 1e-6;
const MAX_EIGEN_ITERATIONS: usize = 10_000;

/// The bound at which an estimate is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Bound {
    /// The smallest value allowed.
    Low,
    /// The largest value allowed.
    High,
}

/// One parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterEstimate {
    /// Path of the parameter.
    pub path: String,
    /// Estimate, in the parameter's SI unit.
    pub value: f64,
    /// 95 % interval in that unit, cut at the bounds; symmetric on the parameter's own scale.
    pub interval: [f64; 2],
    /// Standard error in that unit.
    pub standard_error: f64,
    /// Normalised estimate.
    pub coordinate: f64,
    /// Standard error of the normalised estimate.
    pub coordinate_standard_error: f64,
    /// The bound it is at. Its interval is then computed as if the bound were not there.
    pub at_bound: Option<Bound>,
    /// Whether the data identify it: false for a parameter of a weak direction, or if its own half
    /// interval is longer than half its range.
    pub is_identifiable: bool,
}

/// A direction along which the parameters can move together while the residuals hardly change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WeakDirection {
    /// Singular value of the Jacobian along it, residuals (in standard deviations) per whole range.
    pub singular_value: f64,
    /// Standard error along it, in whole ranges.
    pub standard_error: f64,
    /// The parameters that make it up, with the components of the unit vector, the largest first.
    pub parts: Vec<(String, f64)>,
}

/// How well one block is matched.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlockStatistics {
    /// Name of the block.
    pub name: String,
    /// Number of residuals.
    pub samples: usize,
    /// Equivalent number of independent residuals.
    pub effective_samples: f64,
    /// Root mean square of the residuals; one where nothing but the noise is left.
    pub rms: f64,
}

/// The uncertainty of a fit's result. Matrices are in normalised coordinates, row by row, in the
/// order of the parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The parameters, in order.
    pub parameters: Vec<ParameterEstimate>,
    /// Covariance of the normalised parameters.
    pub covariance: Vec<Vec<f64>>,
    /// Correlation of the parameters; the diagonal is one, and a parameter without variance has no
    /// other correlation.
    pub correlation: Vec<Vec<f64>>,
    /// Singular values of the Jacobian, the largest first; residuals (in standard deviations) per
    /// whole range.
    pub singular_values: Vec<f64>,
    /// Largest singular value over the smallest.
    pub condition: f64,
    /// Directions that are not identifiable: half their 95 % interval is longer than half the
    /// parameters' ranges, or their singular value is below a millionth of the largest. The weakest
    /// first.
    pub weak: Vec<WeakDirection>,
    /// The blocks, in order.
    pub blocks: Vec<BlockStatistics>,
    /// Sum of squared residuals over samples less parameters; one where nothing but the noise is
    /// left.
    pub residual_variance: f64,
}

impl Estimate {
    /// The uncertainty at a point, from its residuals and slopes
    /// ([`JacobianPlan`](crate::JacobianPlan)).
    ///
    /// # Errors
    /// If there are too few residuals, or they are too large.
    pub fn new(problem: &Problem, linear: &Linearisation) -> Result<Self, FitError> {
        let too_large = || {
            FitError::new(
                "residuals or slopes are too large to square; check the noise's standard deviation that divides them",
            )
        };
        let (n, samples) = (problem.space().len(), problem.samples());
        if samples <= n {
            return Err(FitError(format!(
                "{samples} residuals cannot identify {n} parameters; record longer or estimate fewer"
            )));
        }
        let noise = statistics(problem, &linear.residuals);
        let loss = problem.loss();
        let square: Vec<f64> =
            linear.residuals.iter().map(|&r| if loss.is_square_at(r) { 1.0 } else { 0.0 }).collect();
        let ones = vec![1.0; samples];
        let (mut bread, mut meat) = (vec![0.0; n * n], vec![0.0; n * n]);
        for (block, (_, variance)) in noise.iter().enumerate() {
            linear.jacobian.add_gram(block, &square, 1.0, &mut bread);
            linear.jacobian.add_gram(block, &ones, *variance, &mut meat);
        }
        if !bread.iter().chain(&meat).all(|x| x.is_finite()) {
            return Err(too_large());
        }
        let spectrum = Spectrum::of(&bread, n).ok_or_else(too_large)?;
        let covariance = spectrum.covariance(&DMatrix::from_row_slice(n, n, &meat));
        let weak = spectrum.weak(problem, &covariance);
        let parameters = parameters(problem, &linear.point, &covariance, &weak);
        let deviation = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let correlation = |i: usize, j: usize| {
            let both = deviation(i) * deviation(j);
            match (i == j, both > 0.0) {
                (true, _) => 1.0,
                (false, true) => (covariance[(i, j)] / both).clamp(-1.0, 1.0),
                (false, false) => 0.0,
            }
        };
        let squares: f64 = linear.residuals.iter().map(|r| r * r).sum();
        Ok(Self {
            parameters,
            correlation: (0..n).map(|i| (0..n).map(|j| correlation(i, j)).collect()).collect(),
            covariance: (0..n).map(|i| (0..n).map(|j| covariance[(i, j)]).collect()).collect(),
            condition: (spectrum.values[0] / spectrum.values[n - 1]).min(f64::MAX),
            singular_values: spectrum.values,
            weak,
            blocks: noise.into_iter().map(|(block, _)| block).collect(),
            residual_variance: squares / (samples - n) as f64,
        })
    }
}

/// Statistics of each block's residuals, and their variance times autocorrelation time.
fn statistics(problem: &Problem, residuals: &[f64]) -> Vec<(BlockStatistics, f64)> {
    let (loss, samples) = (problem.loss(), problem.samples() as f64);
    // Corrects for the degrees of freedom of the fit.
    let given_back = samples / (samples - problem.space().len() as f64);
    let squares = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
    let pulls: Vec<f64> = residuals.iter().map(|&r| loss.weight(r) * r).collect();
    let ranges = problem.ranges();
    let short = || ranges.iter().filter(|range| range.len() < SHORT_BLOCK);
    let short_squares: f64 = short().map(|range| squares(&pulls[range.clone()])).sum();
    let short_samples: usize = short().map(Range::len).sum();
    let of_block = |(block, range): (&Block, &Range<usize>)| {
        let (pulls, count) = (&pulls[range.clone()], block.samples as f64);
        let (time, variance) = if block.samples < SHORT_BLOCK {
            (1.0, given_back * short_squares / short_samples as f64)
        } else {
            let time = integrated_autocorrelation(pulls);
            (time, given_back * time * squares(pulls) / count)
        };
        let statistics = BlockStatistics {
            name: block.name.clone(),
            samples: block.samples,
            effective_samples: count / time,
            rms: (squares(&residuals[range.clone()]) / count).sqrt(),
        };
        (statistics, variance)
    };
    problem.blocks().iter().zip(&ranges).map(of_block).collect()
}

/// Singular values of the Jacobian and their directions, from the eigenvalues of JᵀJ.
struct Spectrum {
    /// The largest first.
    values: Vec<f64>,
    /// One direction a column, in the order of the values.
    directions: DMatrix<f64>,
}

impl Spectrum {
    fn of(bread: &[f64], n: usize) -> Option<Self> {
        let eigen = SymmetricEigen::try_new(
            DMatrix::from_row_slice(n, n, bread),
            f64::EPSILON,
            MAX_EIGEN_ITERATIONS,
        )?;
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let largest = eigen.eigenvalues[*order.first()?].max(0.0).sqrt();
        // Not zero, so that the error of what is not identifiable is large and finite.
        let least = (MIN_SINGULAR_SHARE * largest).max(1e-100);
        let values = order.iter().map(|&k| eigen.eigenvalues[k].max(0.0).sqrt().max(least)).collect();
        Some(Self { values, directions: eigen.eigenvectors.select_columns(&order) })
    }

    fn covariance(&self, meat: &DMatrix<f64>) -> DMatrix<f64> {
        let mut inner = self.directions.tr_mul(meat) * &self.directions;
        for i in 0..self.values.len() {
            for j in 0..self.values.len() {
                inner[(i, j)] /= (self.values[i] * self.values[j]).powi(2);
            }
        }
        // A direction without any influence on the residuals gets a standard error of ten ranges.
        for (i, value) in self.values.iter().enumerate() {
            if *value <= MIN_SINGULAR_SHARE * self.values[0] || *value <= 1e-100 {
                inner[(i, i)] = inner[(i, i)].clamp(100.0, 1e100);
            }
        }
        &self.directions * inner * self.directions.transpose()
    }

    fn weak(&self, problem: &Problem, covariance: &DMatrix<f64>) -> Vec<WeakDirection> {
        let mut weak = Vec::new();
        for (k, &singular_value) in self.values.iter().enumerate().rev() {
            let direction = self.directions.column(k);
            let standard_error = (direction.transpose() * covariance * direction)[(0, 0)].max(0.0).sqrt();
            let is_weak = HALF_INTERVAL * standard_error > WEAK_HALF_INTERVAL
                || singular_value < WEAK_SHARE * self.values[0];
            if !is_weak {
                continue;
            }
            let mut parts: Vec<(String, f64)> = (problem.space().parameters().iter().zip(direction.iter()))
                .filter(|(_, component)| component.abs() >= MIN_COMPONENT)
                .map(|(parameter, component)| (parameter.path.clone(), *component))
                .collect();
            parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
            weak.push(WeakDirection { singular_value, standard_error, parts });
        }
        weak
    }
}

fn parameters(
    problem: &Problem,
    point: &[f64],
    covariance: &DMatrix<f64>,
    weak: &[WeakDirection],
) -> Vec<ParameterEstimate> {
    let space = problem.space();
    let (values, slopes) = (space.to_physical(point), space.slopes(point));
    let of = |(i, parameter): (usize, &crate::Parameter)| {
        let error = covariance[(i, i)].max(0.0).sqrt();
        let end = |sign: f64| space.value(i, (point[i] + sign * HALF_INTERVAL * error).clamp(0.0, 1.0));
        let at_bound = if point[i] <= AT_BOUND {
            Some(Bound::Low)
        } else if point[i] >= 1.0 - AT_BOUND {
            Some(Bound::High)
        } else {
            None
        };
        ParameterEstimate {
            path: parameter.path.clone(),
            value: values[i],
            interval: [end(-1.0), end(1.0)],
            standard_error: error * slopes[i],
            coordinate: point[i],
            coordinate_standard_error: error,
            at_bound,
            is_identifiable: HALF_INTERVAL * error <= WEAK_HALF_INTERVAL
                && !weak
                    .iter()
                    .any(|direction| direction.parts.iter().any(|(path, _)| *path == parameter.path)),
        }
    };
    space.parameters().iter().enumerate().map(of).collect()
}
