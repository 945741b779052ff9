//! What the methods of a fit exchange with it: candidates and their outcomes.

use serde::{Deserialize, Serialize};

use crate::problem::Problem;
use crate::space::all_inside;

/// A point to evaluate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// Normalised coordinates in [0, 1], one a parameter.
    pub point: Vec<f64>,
    /// Physical values in the order of the parameters, SI units.
    pub values: Vec<f64>,
}

impl Candidate {
    /// The candidate at a normalised point, moved inside the bounds.
    pub fn at(problem: &Problem, point: &[f64]) -> Self {
        let point = all_inside(point);
        Self { values: problem.space().to_physical(&point), point }
    }
}

/// Why a fit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// The cost's gradient is zero along every free parameter.
    Gradient,
    /// The parameters no longer move.
    Step,
    /// Steps no longer lower the cost.
    Cost,
    /// No step lowers the cost, however short: the residuals are rougher than the differences.
    Damping,
    /// The evaluations are used up.
    Budget,
    /// The start could not be evaluated, or too many candidates in a row.
    Failures,
}

/// A candidate's residuals and cost.
pub(crate) struct Outcome<'a> {
    pub residuals: &'a [f64],
    pub cost: f64,
}
