//! What a method of a fit does: it proposes candidates and learns from their outcomes.

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
pub enum Reason {
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

/// What a method has to do. Its state is saved as JSON, so it must hold finite numbers only.
pub(crate) trait Method {
    /// The next batch, a function of the state alone. The fit moves coordinates inside the bounds.
    fn propose(&self, problem: &Problem) -> Vec<Vec<f64>>;
    /// Takes the outcomes of the proposed `points`; `None` for a failure. Returns why the fit ends,
    /// if it does.
    fn learn(
        &mut self,
        problem: &Problem,
        points: &[Vec<f64>],
        outcomes: &[Option<Outcome<'_>>],
    ) -> Option<Reason>;
}
