//! The one interface of all methods: ask for a batch, evaluate it anywhere, tell what came of it.
//!
//! Everything that the methods have in common is here: the best so far, counts, budget, failures, and the
//! saved state. A method itself only proposes points, as a pure function of its state, and learns from them.

use serde::{Deserialize, Serialize};

use crate::bo::Bo;
use crate::config::{ConfigError, MethodConfig};
use crate::lm::Lm;
use crate::method::{Candidate, Method, Outcome, Reason};
use crate::problem::{Evaluation, Problem};
use crate::space::is_point;

/// The candidate with the lowest cost so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// Normalised coordinates in [0, 1].
    pub point: Vec<f64>,
    /// Physical values, SI units.
    pub values: Vec<f64>,
    /// Its cost ([`Problem::cost`]).
    pub cost: f64,
    /// Which evaluation it was, counted from zero.
    pub evaluation: u64,
}

/// Evaluations that do not answer the last batch.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TellError {
    /// Not one for each candidate.
    #[error(
        "{given} evaluations were told for {asked} candidates; tell one for each candidate, in the \
        order asked"
    )]
    Count {
        /// Candidates that were asked.
        asked: usize,
        /// Evaluations that were told.
        given: usize,
    },
    /// Residuals that are not those of the problem.
    #[error(
        "candidate {candidate} of the batch has {given} residuals where the problem has {samples}; give \
        one residual for \
         each sample of each block, whatever the candidate"
    )]
    Samples {
        /// Place in the batch, from zero.
        candidate: usize,
        /// Residuals that the problem has.
        samples: usize,
        /// Residuals that were told.
        given: usize,
    },
    /// The fit is over.
    #[error("the fit has ended, so it takes no more evaluations; start another fit from its best point")]
    Finished,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum State {
    Lm(Box<Lm>),
    Bo(Box<Bo>),
}

impl State {
    fn method(&self) -> &dyn Method {
        match self {
            Self::Lm(lm) => lm.as_ref(),
            Self::Bo(bo) => bo.as_ref(),
        }
    }

    fn method_mut(&mut self) -> &mut dyn Method {
        match self {
            Self::Lm(lm) => lm.as_mut(),
            Self::Bo(bo) => bo.as_mut(),
        }
    }
}

/// A fit under way: its problem, its method and all that was learned.
///
/// It is `Serialize` and `Deserialize`: written after any [`Fit::tell`] and read again, it goes on to the
/// same end, bit for bit (with a format that keeps every bit of a number, such as serde_json with
/// `float_roundtrip`).
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "Saved")]
pub struct Fit {
    problem: Problem,
    max_evaluations: u64,
    state: State,
    best: Option<Best>,
    evaluations: u64,
    failures: u64,
    finished: Option<Reason>,
    /// What the method proposed and is not told yet.
    #[serde(skip)]
    asked: Option<Vec<Vec<f64>>>,
}

/// A fit as it comes from a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    problem: Problem,
    max_evaluations: u64,
    state: State,
    best: Option<Best>,
    evaluations: u64,
    failures: u64,
    finished: Option<Reason>,
}

impl TryFrom<Saved> for Fit {
    type Error = &'static str;

    fn try_from(saved: Saved) -> Result<Self, Self::Error> {
        let Saved { problem, max_evaluations, state, best, evaluations, failures, finished } = saved;
        let n = problem.space().len();
        let best_fits =
            best.as_ref().is_none_or(|b| is_point(&b.point, n) && b.values.len() == n && b.cost.is_finite());
        if !best_fits || !state.method().is_sound(&problem) {
            return Err("the saved fit is damaged or from another version; start it again");
        }
        let asked = None;
        Ok(Self { problem, max_evaluations, state, best, evaluations, failures, finished, asked })
    }
}

impl Fit {
    /// Begins a fit at the parameters' start values.
    ///
    /// `seed` owns every random draw; Levenberg–Marquardt makes none.
    ///
    /// # Errors
    /// [`ConfigError`] names a number that cannot work, or a method that cannot handle so many parameters.
    pub fn new(problem: Problem, method: &MethodConfig, seed: u64) -> Result<Self, ConfigError> {
        method.validate(problem.space().len())?;
        let state = match method {
            MethodConfig::Lm(config) => State::Lm(Box::new(Lm::new(&problem, config.clone()))),
            MethodConfig::Bo(config) => State::Bo(Box::new(Bo::new(config.clone(), seed))),
        };
        Ok(Self {
            problem,
            max_evaluations: method.max_evaluations(),
            state,
            best: None,
            evaluations: 0,
            failures: 0,
            finished: None,
            asked: None,
        })
    }

    /// The next batch, to be evaluated in any order. The same batch until it is told; empty once the fit has
    /// ended.
    pub fn ask(&mut self) -> Vec<Candidate> {
        self.proposed().iter().map(|point| Candidate::at(&self.problem, point)).collect()
    }

    fn proposed(&mut self) -> Vec<Vec<f64>> {
        if self.finished.is_some() {
            return Vec::new();
        }
        self.asked.get_or_insert_with(|| self.state.method().propose(&self.problem)).clone()
    }

    /// Takes what came of the last batch, one evaluation a candidate in the order of [`Fit::ask`].
    ///
    /// Residuals that are not finite (or beyond 1e100) count as a failed evaluation.
    ///
    /// # Errors
    /// [`TellError`] when the evaluations do not answer the batch; nothing has changed then.
    pub fn tell(&mut self, evaluations: &[Evaluation]) -> Result<(), TellError> {
        if self.finished.is_some() {
            return Err(TellError::Finished);
        }
        let points = self.proposed();
        let samples = self.problem.samples();
        if points.len() != evaluations.len() {
            return Err(TellError::Count { asked: points.len(), given: evaluations.len() });
        }
        for (candidate, evaluation) in evaluations.iter().enumerate() {
            if let Evaluation::Residuals(residuals) = evaluation
                && residuals.len() != samples
            {
                return Err(TellError::Samples { candidate, samples, given: residuals.len() });
            }
        }
        let outcomes: Vec<Option<Outcome<'_>>> = evaluations
            .iter()
            .map(|evaluation| {
                let residuals = self.problem.usable(evaluation)?;
                Some(Outcome { residuals, cost: self.problem.cost(residuals) })
            })
            .collect();
        for (point, outcome) in points.iter().zip(&outcomes) {
            match outcome {
                None => self.failures += 1,
                Some(outcome) if self.best.as_ref().is_none_or(|best| outcome.cost < best.cost) => {
                    let Candidate { point, values } = Candidate::at(&self.problem, point);
                    let evaluation = self.evaluations;
                    self.best = Some(Best { point, values, cost: outcome.cost, evaluation });
                }
                Some(_) => {}
            }
            self.evaluations += 1;
        }
        self.finished = self.state.method_mut().learn(&self.problem, &points, &outcomes);
        if self.finished.is_none() && self.evaluations >= self.max_evaluations {
            self.finished = Some(Reason::Budget);
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

    /// Evaluations told so far, failed ones among them.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Evaluations that failed.
    pub fn failures(&self) -> u64 {
        self.failures
    }

    /// Why the fit has ended; `None` while it goes on.
    pub fn finished(&self) -> Option<Reason> {
        self.finished
    }
}
