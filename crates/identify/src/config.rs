//! The constants of the two methods. Their defaults suit residuals in standard deviations of the
//! noise.

use serde::{Deserialize, Serialize};

/// The method of a fit and its constants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method", rename_all = "lowercase")]
pub enum MethodConfig {
    /// Levenberg–Marquardt: for smooth residuals; tens of Jacobians.
    Lm(LmConfig),
    /// Bayesian optimisation: for few parameters and expensive evaluations; hundreds of them.
    Bo(BoConfig),
}

impl MethodConfig {
    /// Evaluations after which no new batch is begun.
    pub(crate) fn max_evaluations(&self) -> u64 {
        match self {
            Self::Lm(config) => config.max_evaluations,
            Self::Bo(config) => config.max_evaluations,
        }
    }
}

/// How slopes are computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Differences {
    /// One step away from the point: one evaluation a parameter, error in proportion to the step.
    #[default]
    Forward,
    /// A step to each side: two evaluations, error in proportion to its square.
    Central,
}

/// Constants of Levenberg–Marquardt. Lengths are in normalised coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LmConfig {
    /// Evaluations after which no new batch is begun.
    pub max_evaluations: u64,
    /// How slopes are computed.
    pub differences: Differences,
    /// Final step of the differences, as a share of a parameter's range.
    pub difference_step: f64,
    /// First step of the differences, if larger. Wide differences average the roughness of a
    /// simulation. Each time the fit converges it continues with a tenth of the step, down to
    /// `difference_step`.
    pub first_difference_step: f64,
    /// Damping at the start, relative to the curvature of each parameter.
    pub initial_damping: f64,
    /// Ends when a step's predicted and actual reductions are a smaller share of the cost.
    pub cost_tolerance: f64,
    /// A parameter is held while the cost's curvature along it is less. With residuals in standard
    /// deviations of the noise, the parameter's own 95 % interval is then wider than `3.92 /
    /// √min_curvature` of its range.
    pub min_curvature: f64,
}

impl Default for LmConfig {
    fn default() -> Self {
        Self {
            max_evaluations: 10_000,
            differences: Differences::Forward,
            difference_step: 1e-5,
            first_difference_step: 1e-5,
            initial_damping: 1e-3,
            cost_tolerance: 1e-9,
            min_curvature: 0.0,
        }
    }
}

impl LmConfig {
    /// Constants for replays of a robot, which are not smooth: contacts and dry friction switch.
    pub fn for_replays() -> Self {
        Self {
            difference_step: 1e-6,
            first_difference_step: 1e-2,
            initial_damping: 10.0,
            cost_tolerance: 1e-4,
            max_evaluations: 400,
            ..Self::default()
        }
    }
}

/// Constants of Bayesian optimisation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BoConfig {
    /// Evaluations after which no new batch is begun.
    pub max_evaluations: u64,
}

impl Default for BoConfig {
    fn default() -> Self {
        Self { max_evaluations: 150 }
    }
}
