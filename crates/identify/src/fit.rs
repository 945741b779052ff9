//! The interface of all methods: ask for a batch, evaluate it, tell the residuals.
//!
//! A fit holds what the methods share: the best candidate so far, counts, budget, failures, and the
//! saved state.

use serde::{Deserialize, Serialize};

use crate::bayesian::Bo;
use crate::config::MethodConfig;
use crate::error::FitError;
use crate::levenberg_marquardt::Lm;
use crate::method::{Candidate, Outcome, StopReason};
use crate::problem::{Evaluation, Problem};

/// Each new candidate of Bayesian optimisation takes time in proportion to the cube of all before.
const MAX_BO_EVALUATIONS: u64 = 2000;

/// The candidate with the lowest cost so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// Normalised coordinates in [0, 1].
    pub point: Vec<f64>,
    /// Physical values, SI units.
    pub values: Vec<f64>,
    /// Its cost ([`Problem::cost`]).
    pub cost: f64,
}

/// The state of the method. It is saved as JSON, so it must hold finite numbers only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum State {
    Lm(Box<Lm>),
    Bo(Box<Bo>),
}

impl State {
    /// The next batch, a function of the state alone. The fit moves coordinates inside the bounds.
    fn propose(&self, problem: &Problem) -> Vec<Vec<f64>> {
        match self {
            Self::Lm(lm) => lm.propose(problem),
            Self::Bo(bo) => bo.propose(problem),
        }
    }

    /// Takes the outcomes of the proposed points; `None` for a failure. Returns why the fit ends,
    /// if it does.
    fn update(
        &mut self,
        problem: &Problem,
        points: &[Vec<f64>],
        outcomes: &[Option<Outcome<'_>>],
    ) -> Option<StopReason> {
        match self {
            Self::Lm(lm) => lm.update(problem, points, outcomes),
            Self::Bo(bo) => bo.update(points, outcomes),
        }
    }
}

/// A fit: its problem, its method and their state.
///
/// Saved after any [`Fit::tell`] and loaded, it ends with the same result, bit for bit, if the
/// format keeps every bit of a number (such as serde_json with `float_roundtrip`).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Fit {
    problem: Problem,
    max_evaluations: u64,
    state: State,
    best: Option<Best>,
    evaluations: u64,
    finished: Option<StopReason>,
    /// The batch that waits for its evaluations.
    #[serde(skip)]
    asked: Option<Vec<Vec<f64>>>,
}

impl Fit {
    /// A fit from the parameters' start values. `seed` determines every random draw;
    /// Levenberg–Marquardt makes none.
    ///
    /// # Errors
    /// If the method may make no evaluation, or more than it can handle.
    pub fn new(problem: Problem, method: &MethodConfig, seed: u64) -> Result<Self, FitError> {
        let max_evaluations = method.max_evaluations();
        let max = if matches!(method, MethodConfig::Bo(_)) { MAX_BO_EVALUATIONS } else { u64::MAX };
        if !(1..=max).contains(&max_evaluations) {
            return Err(FitError(format!(
                "a fit cannot make {max_evaluations} evaluations: give from 1 to {max}"
            )));
        }
        let state = match method {
            MethodConfig::Lm(config) => State::Lm(Box::new(Lm::new(&problem, config.clone()))),
            MethodConfig::Bo(_) => State::Bo(Box::new(Bo::new(seed))),
        };
        Ok(Self { problem, max_evaluations, state, best: None, evaluations: 0, finished: None, asked: None })
    }

    /// The next batch, to be evaluated in any order. The same batch until [`Fit::tell`]; empty
    /// after the end.
    pub fn ask(&mut self) -> Vec<Candidate> {
        self.proposed().iter().map(|point| Candidate::at(&self.problem, point)).collect()
    }

    fn proposed(&mut self) -> Vec<Vec<f64>> {
        if self.finished.is_some() {
            return Vec::new();
        }
        self.asked.get_or_insert_with(|| self.state.propose(&self.problem)).clone()
    }

    /// Takes the evaluations of the last batch, one a candidate in the order of [`Fit::ask`].
    ///
    /// Residuals that are not finite (or beyond 1e100), or of another number than the problem has,
    /// count as a failed evaluation.
    ///
    /// # Errors
    /// If the evaluations do not match the batch; the fit is unchanged then.
    pub fn tell(&mut self, evaluations: &[Evaluation]) -> Result<(), FitError> {
        if self.finished.is_some() {
            let why =
                "the fit has ended, so it takes no more evaluations; start another fit from its best point";
            return Err(FitError::new(why));
        }
        let points = self.proposed();
        if points.len() != evaluations.len() {
            let (asked, given) = (points.len(), evaluations.len());
            return Err(FitError(format!(
                "{given} evaluations were given for {asked} candidates; give one for each candidate, in the order of the batch"
            )));
        }
        let outcomes: Vec<Option<Outcome<'_>>> = evaluations
            .iter()
            .map(|evaluation| {
                let residuals = self.problem.usable(evaluation)?;
                Some(Outcome { residuals, cost: self.problem.cost(residuals) })
            })
            .collect();
        for (point, outcome) in points.iter().zip(&outcomes) {
            if let Some(outcome) = outcome
                && self.best.as_ref().is_none_or(|best| outcome.cost < best.cost)
            {
                let Candidate { point, values } = Candidate::at(&self.problem, point);
                self.best = Some(Best { point, values, cost: outcome.cost });
            }
            self.evaluations += 1;
        }
        self.finished = self.state.update(&self.problem, &points, &outcomes);
        if self.finished.is_none() && self.evaluations >= self.max_evaluations {
            self.finished = Some(StopReason::Budget);
        }
        self.asked = None;
        Ok(())
    }

    /// The problem.
    pub fn problem(&self) -> &Problem {
        &self.problem
    }

    /// The candidate with the lowest cost so far; `None` while every evaluation has failed.
    pub fn best(&self) -> Option<&Best> {
        self.best.as_ref()
    }

    /// Evaluations so far, including failed ones.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Evaluations that it may still make; 0 after its end.
    pub fn max_evaluations_left(&self) -> u64 {
        if self.finished.is_some() { 0 } else { self.max_evaluations.saturating_sub(self.evaluations) }
    }

    /// Why the fit has ended; `None` before its end.
    pub fn finished(&self) -> Option<StopReason> {
        self.finished
    }
}
