//! Every constant of the two methods, with defaults that suit residuals in standard deviations of the
//! noise.

use serde::{Deserialize, Serialize};

/// Dimensions beyond which Bayesian optimisation is refused (fact sheet "speed and sample efficiency" §5).
pub(crate) const BO_MOST_PARAMETERS: usize = 20;

/// A configured value that cannot work.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// A number out of place.
    #[error("`{field}` is {value}, but {rule}; change it in the configuration")]
    Value {
        /// Name of the field, as in the configuration file.
        field: &'static str,
        /// What it was set to.
        value: String,
        /// What it must be.
        rule: &'static str,
    },
    /// More parameters than a Gaussian process can search.
    #[error(
        "Bayesian optimisation takes at most {BO_MOST_PARAMETERS} parameters, not {0}, and works well up to about \
         10. Fit joint by joint, or choose the method `lm`"
    )]
    TooManyForBo(usize),
}

fn require(
    holds: bool,
    field: &'static str,
    value: impl std::fmt::Display,
    rule: &'static str,
) -> Result<(), ConfigError> {
    if holds { Ok(()) } else { Err(ConfigError::Value { field, value: value.to_string(), rule }) }
}

/// The method of a fit and its constants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method", rename_all = "lowercase")]
pub enum MethodConfig {
    /// Levenberg–Marquardt: for smooth residuals; tens of Jacobians.
    Lm(LmConfig),
    /// Bayesian optimisation: for few parameters and dear evaluations; hundreds of them.
    Bo(BoConfig),
}

impl MethodConfig {
    /// Checks every number; `parameters` is the number of parameters.
    pub(crate) fn validate(&self, parameters: usize) -> Result<(), ConfigError> {
        match self {
            Self::Lm(config) => config.validate(),
            Self::Bo(config) => config.validate(parameters),
        }
    }

    pub(crate) fn max_evaluations(&self) -> u64 {
        match self {
            Self::Lm(config) => config.max_evaluations,
            Self::Bo(config) => config.max_evaluations,
        }
    }
}

/// How slopes are measured.
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
#[serde(default, deny_unknown_fields)]
pub struct LmConfig {
    /// Evaluations after which no new batch is begun.
    pub max_evaluations: u64,
    /// How slopes are measured.
    pub differences: Differences,
    /// Step of the differences that the fit ends with, as a share of a parameter's range.
    pub difference_step: f64,
    /// Step that it begins with, if larger. Where a simulation is rough, wide differences still see which way is down; each time
    /// the fit settles it goes on with a tenth of the step, down to `difference_step`.
    pub first_difference_step: f64,
    /// Damping at the start, relative to the curvature of each parameter.
    pub initial_damping: f64,
    /// Ends when the cosine between the residuals and each free column of the Jacobian is smaller.
    pub gradient_tolerance: f64,
    /// Ends when no coordinate would move farther.
    pub step_tolerance: f64,
    /// Ends when a step promises and brings a smaller share of the cost.
    pub cost_tolerance: f64,
    /// A parameter is held while the cost's curvature along it is less. Where residuals are in standard deviations of their noise, a
    /// parameter's own 95 % interval is then wider than `3.92 / √least_curvature` of its range: a step along it would be a guess.
    pub least_curvature: f64,
}

impl Default for LmConfig {
    fn default() -> Self {
        Self {
            max_evaluations: 10_000,
            differences: Differences::Forward,
            difference_step: 1e-5,
            first_difference_step: 1e-5,
            initial_damping: 1e-3,
            gradient_tolerance: 1e-8,
            step_tolerance: 1e-7,
            cost_tolerance: 1e-9,
            least_curvature: 0.0,
        }
    }
}

impl LmConfig {
    /// Constants that suit replays of a robot, which are not smooth to the last digit: contacts and dry friction switch.
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

    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        require(self.max_evaluations > 0, "max_evaluations", self.max_evaluations, "it must be positive")?;
        let step = self.difference_step;
        require((1e-9..=0.1).contains(&step), "difference_step", step, "it must lie in 1e-9 … 0.1")?;
        let first = self.first_difference_step;
        let rule = "it must lie in 1e-9 … 0.1";
        require((1e-9..=0.1).contains(&first), "first_difference_step", first, rule)?;
        let damping = self.initial_damping;
        require(
            (1e-12..=1e12).contains(&damping),
            "initial_damping",
            damping,
            "it must lie in 1e-12 … 1e12",
        )?;
        for (field, value) in [
            ("gradient_tolerance", self.gradient_tolerance),
            ("step_tolerance", self.step_tolerance),
            ("cost_tolerance", self.cost_tolerance),
        ] {
            require((0.0..1.0).contains(&value), field, value, "it must lie in 0 … 1, without 1")?;
        }
        let least = self.least_curvature;
        require((0.0..=1e12).contains(&least), "least_curvature", least, "it must lie in 0 … 1e12")?;
        Ok(())
    }
}

/// Constants of Bayesian optimisation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoConfig {
    /// Evaluations after which no new batch is begun.
    pub max_evaluations: u64,
    /// Candidates of the first batch, spread over the whole space; 0 takes 2 n + 2.
    pub initial: usize,
    /// Candidates of each later batch. One learns most from each evaluation; more keep as many cores busy.
    pub batch: usize,
}

impl Default for BoConfig {
    fn default() -> Self {
        Self { max_evaluations: 150, initial: 0, batch: 1 }
    }
}

impl BoConfig {
    pub(crate) fn validate(&self, parameters: usize) -> Result<(), ConfigError> {
        if parameters > BO_MOST_PARAMETERS {
            return Err(ConfigError::TooManyForBo(parameters));
        }
        let rule = "it must lie in 1 … 2000, since each new candidate takes time in proportion to the \
        cube of all before";
        require((1..=2000).contains(&self.max_evaluations), "max_evaluations", self.max_evaluations, rule)?;
        let rule = "it must be 0 or lie in 3 … 2000";
        require(self.initial == 0 || (3..=2000).contains(&self.initial), "initial", self.initial, rule)?;
        require((1..=64).contains(&self.batch), "batch", self.batch, "it must lie in 1 … 64")
    }
}
