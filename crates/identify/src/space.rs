//! The parameters of a fit: names, bounds, and the unit cube in which the methods work.
//!
//! A method sees every parameter as a coordinate in [0, 1], so that steps and singular values of
//! different parameters are comparable. Only this file converts between coordinates and physical
//! values.

use serde::{Deserialize, Serialize};

use crate::error::FitError;

/// How a physical value follows its normalised coordinate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// Proportional.
    #[default]
    Linear,
    /// Equal ratios for equal distances; both bounds must be positive.
    Logarithmic,
}

/// A parameter to estimate. Bounds, start and step are in the parameter's own SI unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Path as in `etude_stage::PhysicalParams::rows`, such as `joint.index_1.damping`.
    pub path: String,
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
    /// Where the fit starts.
    pub start: f64,
    /// How the value follows the normalised coordinate.
    #[serde(default)]
    pub scale: Scale,
    /// Names of the residual blocks ([`Block`](crate::Block)) that the parameter can influence;
    /// empty means all. Parameters without a block in common are perturbed together when a Jacobian
    /// is measured.
    #[serde(default)]
    pub influences: Vec<String>,
}

impl Parameter {
    /// A continuous parameter that may influence every residual.
    pub fn new(path: &str, low: f64, high: f64, start: f64) -> Self {
        let scale = Scale::Linear;
        Self { path: path.to_string(), low, high, start, scale, influences: Vec::new() }
    }

    /// The same on a logarithmic scale.
    pub fn logarithmic(self) -> Self {
        Self { scale: Scale::Logarithmic, ..self }
    }

    /// The same, influencing only these blocks of residuals.
    pub fn influencing<S: Into<String>>(self, blocks: impl IntoIterator<Item = S>) -> Self {
        Self { influences: blocks.into_iter().map(Into::into).collect(), ..self }
    }
}

/// The parameters of a fit and their unit cube. Points have one entry a parameter, in order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Space {
    parameters: Vec<Parameter>,
}

impl Space {
    /// A space of these parameters, whose paths differ.
    ///
    /// # Errors
    /// If a parameter is invalid.
    pub fn new(parameters: Vec<Parameter>) -> Result<Self, FitError> {
        if parameters.is_empty() {
            return Err(FitError::new("there is no parameter to estimate; name at least one"));
        }
        parameters.iter().try_for_each(check)?;
        Ok(Self { parameters })
    }

    /// The parameters, in order.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Number of parameters, at least one.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.parameters.len()
    }

    /// Normalised start.
    pub fn start(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| normalised(p, p.start)).collect()
    }

    /// Physical values of a normalised point, clamped to the bounds.
    pub fn to_physical(&self, point: &[f64]) -> Vec<f64> {
        self.parameters.iter().zip(point).map(|(p, &u)| physical(p, inside(u))).collect()
    }

    /// Normalised point of physical values, clamped to the bounds.
    pub fn to_normalised(&self, values: &[f64]) -> Vec<f64> {
        self.parameters.iter().zip(values).map(|(p, &v)| normalised(p, v)).collect()
    }

    /// Physical change of each parameter per unit of its normalised coordinate, at `point`.
    pub(crate) fn slopes(&self, point: &[f64]) -> Vec<f64> {
        let slope = |(p, &u): (&Parameter, &f64)| match p.scale {
            Scale::Linear => p.high - p.low,
            Scale::Logarithmic => physical(p, u) * (p.high / p.low).ln(),
        };
        self.parameters.iter().zip(point).map(slope).collect()
    }

    /// Physical value of a coordinate of parameter `index`.
    pub(crate) fn value(&self, index: usize, coordinate: f64) -> f64 {
        self.parameters.get(index).map_or(f64::NAN, |p| physical(p, coordinate))
    }
}

/// Nearest coordinate in [0, 1]; 0 for NaN.
pub(crate) fn inside(coordinate: f64) -> f64 {
    if coordinate.is_nan() { 0.0 } else { coordinate.clamp(0.0, 1.0) }
}

/// The same for a whole point.
pub(crate) fn all_inside(point: &[f64]) -> Vec<f64> {
    point.iter().copied().map(inside).collect()
}

fn check(p: &Parameter) -> Result<(), FitError> {
    let Parameter { path, low, high, start, .. } = p;
    let finite = low.is_finite() && high.is_finite() && (high - low).is_finite();
    if !finite || low >= high || !(low..=high).contains(&start) {
        return Err(FitError(format!(
            "parameter `{path}`: bounds {low} … {high} and start {start} are not in order; give finite numbers with \
             low < high and low <= start <= high"
        )));
    }
    // The smallest normal number, since the ratio of the bounds must be finite too.
    let spans = *low >= f64::MIN_POSITIVE && (high / low).is_finite();
    if p.scale == Scale::Logarithmic && !spans {
        return Err(FitError(format!(
            "parameter `{path}` has a logarithmic scale, but its lower bound is {low}; raise it above zero or make it \
             linear"
        )));
    }
    Ok(())
}

fn physical(p: &Parameter, coordinate: f64) -> f64 {
    let value = match p.scale {
        Scale::Linear => p.low + coordinate * (p.high - p.low),
        Scale::Logarithmic => p.low * ((p.high / p.low).ln() * coordinate).exp(),
    };
    value.clamp(p.low, p.high)
}

fn normalised(p: &Parameter, value: f64) -> f64 {
    let value = if value.is_nan() { p.low } else { value.clamp(p.low, p.high) };
    let coordinate = match p.scale {
        Scale::Linear => (value - p.low) / (p.high - p.low),
        Scale::Logarithmic => (value / p.low).ln() / (p.high / p.low).ln(),
    };
    coordinate.clamp(0.0, 1.0)
}
