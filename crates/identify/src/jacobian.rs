//! The Jacobian by finite differences, in one batch of candidates. Parameters without a common
//! block are perturbed together, so that thirteen joints with eight parameters each cost 8
//! simulations instead of 104.

use crate::config::Differences;
use crate::error::FitError;
use crate::method::Candidate;
use crate::problem::{Evaluation, Problem};
use crate::space::all_inside;

/// Slopes of the residuals with respect to the normalised coordinates; only blocks that a parameter
/// influences are kept.
#[derive(Clone, Debug, PartialEq)]
pub struct Jacobian {
    columns: Vec<Vec<BlockSlopes>>,
}

/// One block of one column.
#[derive(Clone, Debug, PartialEq)]
struct BlockSlopes {
    block: usize,
    /// Index of its first residual.
    start: usize,
    slopes: Vec<f64>,
}

impl Jacobian {
    /// Adds a block's `scale · JᵀWJ` to `sum` (row by row, parameters × parameters); `weights` are
    /// of all residuals.
    pub(crate) fn add_gram(&self, block: usize, weights: &[f64], scale: f64, sum: &mut [f64]) {
        let n = self.columns.len();
        let parts: Vec<(usize, &BlockSlopes)> = self
            .columns
            .iter()
            .enumerate()
            .filter_map(|(i, parts)| Some((i, parts.iter().find(|part| part.block == block)?)))
            .collect();
        for (position, (i, left)) in parts.iter().enumerate() {
            for (j, right) in &parts[position..] {
                let products = left.slopes.iter().zip(&right.slopes).zip(&weights[left.start..]);
                let product = scale * products.map(|((a, b), w)| a * b * w).sum::<f64>();
                sum[i * n + j] += product;
                if i != j {
                    sum[j * n + i] += product;
                }
            }
        }
    }

    /// `Jᵀ v` for a vector over all residuals.
    pub(crate) fn transposed_times(&self, vector: &[f64]) -> Vec<f64> {
        let along = |part: &BlockSlopes| -> f64 {
            part.slopes.iter().zip(&vector[part.start..]).map(|(slope, v)| slope * v).sum()
        };
        self.columns.iter().map(|parts| parts.iter().map(along).sum()).collect()
    }
}

/// One candidate of a Jacobian: the point and the parameters that differ.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Probe {
    pub point: Vec<f64>,
    /// Parameter and signed distance, normalised.
    pub moved: Vec<(usize, f64)>,
}

/// Disjoint sets of all parameters; no two parameters of a set influence the same block.
pub(crate) fn colours(problem: &Problem) -> Vec<Vec<usize>> {
    let blocks = problem.blocks().len();
    let mut sets: Vec<(Vec<usize>, Vec<bool>)> = Vec::new();
    for parameter in 0..problem.space().len() {
        let wanted = problem.influenced(parameter);
        let free = sets.iter().position(|(_, taken)| wanted.iter().all(|&block| !taken[block]));
        let index = free.unwrap_or_else(|| {
            sets.push((Vec::new(), vec![false; blocks]));
            sets.len() - 1
        });
        let (members, taken) = &mut sets[index];
        members.push(parameter);
        wanted.iter().for_each(|&block| taken[block] = true);
    }
    sets.into_iter().map(|(members, _)| members).collect()
}

/// How far to move a parameter from `at` in the direction of `sign`; zero where that leaves the
/// bounds.
///
/// The distance is the rounded one, so that the difference of the two coordinates is exact.
fn distance(at: f64, sign: f64, step: f64) -> f64 {
    let target = at + sign * step;
    if (0.0..=1.0).contains(&target) { target - at } else { 0.0 }
}

/// The candidates of a Jacobian at `point`, without the point itself.
///
/// `attempts` counts the failures of each parameter's probes: the second attempt goes the other
/// way, the third a tenth of the step.
pub(crate) fn probes(
    problem: &Problem,
    point: &[f64],
    differences: Differences,
    step: f64,
    attempts: &[u8],
) -> Vec<Probe> {
    let probe = |members: &[usize], distance_of: &dyn Fn(usize) -> f64| -> Option<Probe> {
        let moved: Vec<(usize, f64)> =
            members.iter().map(|&p| (p, distance_of(p))).filter(|(_, d)| *d != 0.0).collect();
        let mut moved_point = point.to_vec();
        for &(parameter, distance) in &moved {
            moved_point[parameter] += distance;
        }
        (!moved.is_empty()).then_some(Probe { point: moved_point, moved })
    };
    let mut all = Vec::new();
    for members in colours(problem) {
        let attempt = |p: usize| attempts.get(p).copied().unwrap_or(0);
        match differences {
            Differences::Forward => {
                let forward = |p: usize| {
                    let sign = if attempt(p) == 1 { -1.0 } else { 1.0 };
                    let step = if attempt(p) >= 2 { 0.1 * step } else { step };
                    match distance(point[p], sign, step) {
                        0.0 => distance(point[p], -sign, step),
                        d => d,
                    }
                };
                all.extend(probe(&members, &forward));
            }
            Differences::Central => {
                for sign in [1.0, -1.0] {
                    let to_side = |p: usize| distance(point[p], sign, step * 0.1f64.powi(attempt(p).into()));
                    all.extend(probe(&members, &to_side));
                }
            }
        }
    }
    all
}

/// The Jacobian from the probes' residuals, and the parameters without any successful probe, whose
/// columns are zero.
pub(crate) fn assemble(
    problem: &Problem,
    base: &[f64],
    probes: &[Probe],
    outcomes: &[Option<&[f64]>],
) -> (Jacobian, Vec<usize>) {
    let mut columns = Vec::with_capacity(problem.space().len());
    let mut missing = Vec::new();
    let ranges = problem.ranges();
    for parameter in 0..problem.space().len() {
        // Lowest and highest of the base and the successful probes.
        let (mut low, mut high) = ((0.0, base), (0.0, base));
        for (probe, outcome) in probes.iter().zip(outcomes) {
            let moved = probe.moved.iter().find(|(p, _)| *p == parameter);
            if let (Some(&(_, distance)), Some(residuals)) = (moved, outcome) {
                if distance < low.0 {
                    low = (distance, residuals);
                } else if distance > high.0 {
                    high = (distance, residuals);
                }
            }
        }
        let width = high.0 - low.0;
        if width == 0.0 {
            missing.push(parameter);
            columns.push(Vec::new());
            continue;
        }
        let part = |&block: &usize| {
            let range = ranges[block].clone();
            let start = range.start;
            let slopes = high.1[range.clone()].iter().zip(&low.1[range]).map(|(h, l)| (h - l) / width);
            BlockSlopes { block, start, slopes: slopes.collect() }
        };
        columns.push(problem.influenced(parameter).iter().map(part).collect());
    }
    (Jacobian { columns }, missing)
}

/// The candidates for the Jacobian at a point, for [`Estimate`](crate::Estimate) after any method.
#[derive(Clone, Debug)]
pub struct JacobianPlan {
    point: Vec<f64>,
    probes: Vec<Probe>,
}

impl JacobianPlan {
    /// Plans central differences at `point` (normalised); `step` is a share of each range. Towards
    /// a bound, or over a failed neighbour, a parameter's difference is one-sided.
    pub fn new(problem: &Problem, point: &[f64], step: f64) -> Self {
        let mut point = all_inside(point);
        point.resize(problem.space().len(), 0.0);
        let step = if step.is_finite() { step.clamp(1e-9, 0.1) } else { 1e-5 };
        let probes = probes(problem, &point, Differences::Central, step, &[]);
        Self { point, probes }
    }

    /// The batch, the point itself first. In any order, on any number of threads.
    pub fn candidates(&self, problem: &Problem) -> Vec<Candidate> {
        let probes = self.probes.iter().map(|probe| &probe.point);
        std::iter::once(&self.point).chain(probes).map(|point| Candidate::at(problem, point)).collect()
    }

    /// The Jacobian from the evaluations, in the order of [`JacobianPlan::candidates`].
    ///
    /// # Errors
    /// If an evaluation is missing or failed.
    pub fn finish(&self, problem: &Problem, evaluations: &[Evaluation]) -> Result<Linearisation, FitError> {
        let asked = self.probes.len() + 1;
        let outcomes: Vec<Option<&[f64]>> = evaluations.iter().map(|e| problem.usable(e)).collect();
        let Some((base, others)) = outcomes.split_first().filter(|_| outcomes.len() == asked) else {
            let given = evaluations.len();
            return Err(FitError(format!(
                "{given} evaluations were given for {asked} candidates; give one for each, in their order"
            )));
        };
        let base = base
            .ok_or_else(|| FitError::new("the point could not be evaluated; use the best point of a fit"))?;
        let (jacobian, missing) = assemble(problem, base, &self.probes, others);
        match missing.first().and_then(|&parameter| problem.space().parameters().get(parameter)) {
            Some(parameter) => Err(FitError(format!(
                "no neighbour of the point could be evaluated along `{}`; use a smaller difference step, or hold that \
                 parameter fixed",
                parameter.path
            ))),
            None => Ok(Linearisation { point: self.point.clone(), residuals: base.to_vec(), jacobian }),
        }
    }
}

/// The residuals near a point, to first order.
#[derive(Clone, Debug, PartialEq)]
pub struct Linearisation {
    /// Normalised point.
    pub point: Vec<f64>,
    /// Residuals at the point.
    pub residuals: Vec<f64>,
    /// Their slopes there.
    pub jacobian: Jacobian,
}
