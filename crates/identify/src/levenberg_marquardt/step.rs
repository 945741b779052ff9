//! The quadratic model of the cost from a Jacobian, and its best step within the bounds.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::jacobian::Jacobian;
use crate::problem::Problem;
use crate::space::inside;

/// Damping in the model of a parameter without curvature, as a share of the largest curvature.
const MIN_SCALE: f64 = 1e-10;

/// Slopes and curvatures of the cost in normalised coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Model {
    /// Jᵀ W r.
    gradient: Vec<f64>,
    /// Jᵀ W J, row by row.
    hessian: Vec<f64>,
    /// Largest curvature of each parameter so far, which scales its damping (Moré 1978).
    scale: Vec<f64>,
    /// Length of the weighted residuals.
    length: f64,
    /// Parameters with less curvature are held.
    min_curvature: f64,
}

/// A step and its predicted reduction of the cost.
pub(super) struct Step {
    pub point: Vec<f64>,
    pub predicted: f64,
}

impl Model {
    pub(super) fn new(n: usize, min_curvature: f64) -> Self {
        let (gradient, hessian, scale) = (vec![0.0; n], vec![0.0; n * n], vec![0.0; n]);
        Self { gradient, hessian, scale, length: 0.0, min_curvature }
    }

    pub(super) fn measure(&mut self, problem: &Problem, residuals: &[f64], jacobian: &Jacobian) {
        let weights: Vec<f64> = residuals.iter().map(|&r| problem.loss().weight(r)).collect();
        let weighted: Vec<f64> = residuals.iter().zip(&weights).map(|(r, w)| r * w).collect();
        self.gradient = jacobian.transposed_times(&weighted);
        self.hessian.fill(0.0);
        for block in 0..problem.blocks().len() {
            jacobian.add_gram(block, &weights, 1.0, &mut self.hessian);
        }
        self.length = residuals.iter().zip(&weighted).map(|(r, w)| r * w).sum::<f64>().sqrt();
        for (i, scale) in self.scale.iter_mut().enumerate() {
            *scale = scale.max(self.hessian[i * self.gradient.len() + i]);
        }
    }

    fn curvature(&self, i: usize, j: usize) -> f64 {
        self.hessian[i * self.gradient.len() + j]
    }

    /// Whether a parameter is at a bound and its slope points outward, or the residuals hardly
    /// depend on it.
    fn is_held(&self, point: &[f64], i: usize) -> bool {
        let outward =
            (point[i] <= 0.0 && self.gradient[i] >= 0.0) || (point[i] >= 1.0 && self.gradient[i] <= 0.0);
        outward || self.curvature(i, i) < self.min_curvature
    }

    /// Largest cosine between the residuals and the column of a parameter that is not held.
    pub(super) fn steepest(&self, point: &[f64]) -> f64 {
        (0..point.len()).filter(|&i| !self.is_held(point, i)).fold(0.0, |most, i| {
            let lengths = self.curvature(i, i).sqrt() * self.length;
            if lengths > 0.0 { most.max(self.gradient[i].abs() / lengths) } else { most }
        })
    }

    /// The step to the model's minimum within the bounds under `damping`; `None` if the damped
    /// matrix is singular.
    pub(super) fn step(&self, point: &[f64], damping: f64) -> Option<Step> {
        let n = point.len();
        let held: Vec<Option<f64>> = (0..n).map(|i| self.is_held(point, i).then_some(0.0)).collect();
        let delta = self.solve(point, damping, held)?;
        let point_after: Vec<f64> = point.iter().zip(&delta).map(|(u, d)| inside(u + d)).collect();
        let moved: Vec<f64> = point_after.iter().zip(point).map(|(after, before)| after - before).collect();
        let mut change = 0.0;
        for i in 0..n {
            let bent: f64 = (0..n).map(|j| self.curvature(i, j) * moved[j]).sum();
            change += moved[i] * (self.gradient[i] + 0.5 * bent);
        }
        Some(Step { point: point_after, predicted: -change })
    }

    /// Minimises `gᵀδ + ½ δᵀ(H + damping · D)δ` with the displacements in `fixed` given and the
    /// others inside the box.
    fn solve(&self, point: &[f64], damping: f64, mut fixed: Vec<Option<f64>>) -> Option<Vec<f64>> {
        let largest = self.scale.iter().fold(0.0f64, |largest, &s| largest.max(s));
        let scale = |i: usize| damping * self.scale[i].max(MIN_SCALE * largest).max(f64::MIN_POSITIVE);
        // Each iteration puts at least one more parameter on its bound.
        loop {
            let free: Vec<usize> = (0..point.len()).filter(|&i| fixed[i].is_none()).collect();
            let matrix = DMatrix::from_fn(free.len(), free.len(), |a, b| {
                self.curvature(free[a], free[b]) + if a == b { scale(free[a]) } else { 0.0 }
            });
            let right = DVector::from_fn(free.len(), |a, _| {
                let pulls =
                    fixed.iter().enumerate().filter_map(|(j, d)| Some(self.curvature(free[a], j) * (*d)?));
                -self.gradient[free[a]] - pulls.sum::<f64>()
            });
            let solution = match free.len() {
                0 => right,
                _ => matrix.cholesky()?.solve(&right),
            };
            if !solution.iter().all(|d| d.is_finite()) {
                return None;
            }
            let mut inside = true;
            for (&i, d) in free.iter().zip(solution.iter()) {
                let bounded = (point[i] + d).clamp(0.0, 1.0);
                if bounded != point[i] + d {
                    fixed[i] = Some(bounded - point[i]);
                    inside = false;
                }
            }
            if inside {
                let mut delta: Vec<f64> = fixed.iter().map(|d| d.unwrap_or(0.0)).collect();
                free.iter().zip(solution.iter()).for_each(|(&i, &d)| delta[i] = d);
                return Some(delta);
            }
        }
    }
}
