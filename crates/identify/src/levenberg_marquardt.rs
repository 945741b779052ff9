//! Levenberg–Marquardt with bounds: Gauss–Newton steps on slopes by finite differences, with a
//! damping that depends on the ratio of actual to predicted reduction.
//!
//! Bounds are an active set: a parameter at its bound whose slope points outward is held. One that
//! a step would move over its bound is put on the bound, and the others are solved for again.
//!
//! Not a library: none does all of ask/tell, bounds and a state that is saved after each batch.

use serde::{Deserialize, Serialize};

use crate::config::LmConfig;
use crate::jacobian::{assemble, probes};
use crate::method::{Outcome, StopReason};
use crate::problem::Problem;
use crate::space::all_inside;

mod step;

use step::Model;

/// A step is accepted from this ratio of actual to predicted reduction on.
const MIN_GAIN: f64 = 1e-4;
/// The damping falls 10-fold above this ratio.
const TRUSTED: f64 = 0.9;
/// The fit ends when the cosine between the residuals and each free column of the Jacobian is
/// smaller.
const GRADIENT_TOLERANCE: f64 = 1e-8;
/// The fit ends when no coordinate would move farther than this.
const STEP_TOLERANCE: f64 = 1e-7;
const DAMPING_LIMITS: [f64; 2] = [1e-12, 1e15];
/// Attempts of a failed probe at other distances, before its parameter is held for one step.
const MAX_ATTEMPTS: u8 = 3;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Phase {
    /// The start is evaluated.
    Start,
    /// The Jacobian at the point is evaluated; failures of each parameter's probes.
    Jacobian { attempts: Vec<u8> },
    /// A step is evaluated, with its predicted reduction of the cost.
    Trial { point: Vec<f64>, predicted: f64 },
}

/// State of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Lm {
    config: LmConfig,
    phase: Phase,
    /// The current point, its cost and its residuals.
    point: Vec<f64>,
    cost: f64,
    residuals: Vec<f64>,
    /// Slopes and curvatures there, from the last Jacobian.
    model: Model,
    /// Current step of the differences.
    difference_step: f64,
    damping: f64,
    /// Factor by which the next rejection raises the damping (Nielsen 1999).
    growth: f64,
}

impl Lm {
    pub(crate) fn new(problem: &Problem, config: LmConfig) -> Self {
        let point = problem.space().start();
        let difference_step = config.first_difference_step.max(config.difference_step);
        let damping = config.initial_damping;
        Self {
            model: Model::new(point.len(), config.min_curvature),
            config,
            phase: Phase::Start,
            point,
            cost: 0.0,
            residuals: Vec::new(),
            difference_step,
            damping,
            growth: 2.0,
        }
    }

    pub(crate) fn propose(&self, problem: &Problem) -> Vec<Vec<f64>> {
        match &self.phase {
            Phase::Start => vec![self.point.clone()],
            Phase::Jacobian { attempts } => {
                self.jacobian_probes(problem, attempts).into_iter().map(|probe| probe.point).collect()
            }
            Phase::Trial { point, .. } => vec![point.clone()],
        }
    }

    pub(crate) fn update(
        &mut self,
        problem: &Problem,
        points: &[Vec<f64>],
        outcomes: &[Option<Outcome<'_>>],
    ) -> Option<StopReason> {
        let first = outcomes.first().and_then(Option::as_ref);
        match self.phase.clone() {
            Phase::Start => match (points.first(), first) {
                (Some(point), Some(outcome)) => {
                    self.move_to(point, outcome);
                    None
                }
                _ => Some(StopReason::Failures),
            },
            Phase::Jacobian { attempts } => self.update_jacobian(problem, attempts, outcomes),
            Phase::Trial { point, predicted } => self.update_trial(&point, predicted, first),
        }
    }

    fn begin_jacobian(&mut self) {
        self.phase = Phase::Jacobian { attempts: vec![0; self.point.len()] };
    }

    fn move_to(&mut self, point: &[f64], outcome: &Outcome<'_>) {
        self.point = all_inside(point);
        self.cost = outcome.cost;
        self.residuals = outcome.residuals.to_vec();
        self.begin_jacobian();
    }

    /// Continues with finer differences, or ends for `reason` if they are the finest.
    fn settle(&mut self, reason: StopReason) -> Option<StopReason> {
        if self.difference_step <= self.config.difference_step {
            return Some(reason);
        }
        self.difference_step = (0.1 * self.difference_step).max(self.config.difference_step);
        (self.damping, self.growth) = (self.damping.min(self.config.initial_damping), 2.0);
        self.model = Model::new(self.point.len(), self.config.min_curvature);
        self.begin_jacobian();
        None
    }

    /// Prepares the next step, or returns why the fit ends.
    fn decide(&mut self) -> Option<StopReason> {
        if self.model.steepest(&self.point) <= GRADIENT_TOLERANCE {
            return self.settle(StopReason::Gradient);
        }
        while self.damping <= DAMPING_LIMITS[1] {
            let Some(step) = self.model.step(&self.point, self.damping) else {
                self.reject();
                continue;
            };
            let moves: Vec<f64> = step.point.iter().zip(&self.point).map(|(a, b)| (a - b).abs()).collect();
            let small = if moves.iter().all(|d| *d <= STEP_TOLERANCE) {
                Some(StopReason::Step)
            } else if step.predicted <= self.config.cost_tolerance * self.cost {
                Some(StopReason::Cost)
            } else {
                None
            };
            if let Some(reason) = small {
                // A step that is small only because of damping has not converged.
                return self.settle(if self.damping <= 1.0 { reason } else { StopReason::Damping });
            }
            self.phase = Phase::Trial { point: step.point, predicted: step.predicted };
            return None;
        }
        self.settle(StopReason::Damping)
    }

    fn reject(&mut self) {
        self.damping *= self.growth;
        self.growth = (2.0 * self.growth).min(1e6);
    }

    fn update_jacobian(
        &mut self,
        problem: &Problem,
        mut attempts: Vec<u8>,
        outcomes: &[Option<Outcome<'_>>],
    ) -> Option<StopReason> {
        let probes = self.jacobian_probes(problem, &attempts);
        let residuals: Vec<Option<&[f64]>> =
            outcomes.iter().map(|outcome| outcome.as_ref().map(|o| o.residuals)).collect();
        let (jacobian, missing) = assemble(problem, &self.residuals, &probes, &residuals);
        let again: Vec<usize> = missing.into_iter().filter(|&p| attempts[p] + 1 < MAX_ATTEMPTS).collect();
        if !again.is_empty() {
            again.iter().for_each(|&p| attempts[p] += 1);
            self.phase = Phase::Jacobian { attempts };
            return None;
        }
        self.model.measure(problem, &self.residuals, &jacobian);
        self.decide()
    }

    fn jacobian_probes(&self, problem: &Problem, attempts: &[u8]) -> Vec<crate::jacobian::Probe> {
        probes(problem, &self.point, self.config.differences, self.difference_step, attempts)
    }

    fn update_trial(
        &mut self,
        point: &[f64],
        predicted: f64,
        outcome: Option<&Outcome<'_>>,
    ) -> Option<StopReason> {
        let accepted = outcome.filter(|o| self.cost - o.cost > MIN_GAIN * predicted);
        let Some(outcome) = accepted else {
            self.reject();
            return self.decide();
        };
        let reduction = self.cost - outcome.cost;
        let tolerance = self.config.cost_tolerance * self.cost;
        let gain = reduction / predicted;
        // Nielsen's rule, and a faster fall where the model predicts almost exactly.
        let nielsen = (1.0 - (2.0 * gain - 1.0).powi(3)).clamp(1.0 / 3.0, 2.0);
        let factor = if gain > TRUSTED { 0.1 } else { nielsen };
        self.damping = (self.damping * factor).clamp(DAMPING_LIMITS[0], DAMPING_LIMITS[1]);
        self.growth = 2.0;
        self.move_to(point, outcome);
        if reduction <= tolerance && predicted <= tolerance {
            return self.settle(StopReason::Cost);
        }
        None
    }
}
