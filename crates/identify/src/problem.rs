//! What is minimised: the residuals of a candidate in blocks, and their cost.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::error::FitError;
use crate::space::Space;

/// A residual beyond this counts as a failure: its square and its differences would leave the range
/// of numbers.
const MAX_RESIDUAL: f64 = 1e100;

/// A series of residuals in the order of time, such as one joint in one recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Name, for [`Parameter::influences`](crate::Parameter::influences) and the statistics.
    pub name: String,
    /// Number of residuals.
    pub samples: usize,
}

impl Block {
    /// A block of this name and length.
    pub fn new(name: &str, samples: usize) -> Self {
        Self { name: name.to_string(), samples }
    }
}

/// The cost of a residual.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Loss {
    /// Half its square.
    #[default]
    Squared,
    /// Half its square up to this many standard deviations of the noise, in proportion beyond
    /// (Huber 1964).
    Huber(f64),
}

impl Loss {
    /// Cost of one residual.
    pub fn cost(self, residual: f64) -> f64 {
        match self {
            Self::Huber(bend) if residual.abs() > bend => bend * (residual.abs() - 0.5 * bend),
            _ => 0.5 * residual * residual,
        }
    }

    /// Slope of the cost divided by the residual: one for a square, less for an outlier.
    pub fn weight(self, residual: f64) -> f64 {
        match self {
            Self::Huber(bend) if residual.abs() > bend => bend / residual.abs(),
            _ => 1.0,
        }
    }

    /// Whether the residual is where the cost is a square.
    pub(crate) fn is_square_at(self, residual: f64) -> bool {
        !matches!(self, Self::Huber(bend) if residual.abs() > bend)
    }
}

/// The evaluation of a candidate: residuals of all blocks, one block after the other, divided by
/// the standard deviation of the noise; `None` if it failed, for example because the simulation
/// diverged.
pub type Evaluation = Option<Vec<f64>>;

/// Parameters, blocks of residuals and the loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Problem {
    space: Space,
    blocks: Vec<Block>,
    loss: Loss,
}

impl Problem {
    /// A problem. Blocks have different names, and the parameters influence some of them.
    ///
    /// # Errors
    /// If there is no residual.
    pub fn new(space: Space, blocks: Vec<Block>, loss: Loss) -> Result<Self, FitError> {
        if blocks.is_empty() || blocks.iter().any(|block| block.samples == 0) {
            let why = "there is no residual; give at least one block with at least one sample";
            return Err(FitError::new(why));
        }
        Ok(Self { space, blocks, loss })
    }

    /// The parameters.
    pub fn space(&self) -> &Space {
        &self.space
    }

    /// The blocks of residuals, in order.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The loss.
    pub fn loss(&self) -> Loss {
        self.loss
    }

    /// Number of residuals of a candidate.
    pub fn samples(&self) -> usize {
        self.blocks.iter().map(|block| block.samples).sum()
    }

    /// Range of each block in the residuals.
    pub fn ranges(&self) -> Vec<Range<usize>> {
        let mut end = 0;
        let range = |block: &Block| {
            end += block.samples;
            end - block.samples..end
        };
        self.blocks.iter().map(range).collect()
    }

    /// Cost of residuals: the sum of the losses. With the squared loss and pure noise it is half
    /// their number.
    pub fn cost(&self, residuals: &[f64]) -> f64 {
        residuals.iter().map(|&r| self.loss().cost(r)).sum()
    }

    /// Blocks that a parameter influences, in order.
    pub(crate) fn influenced(&self, parameter: usize) -> Vec<usize> {
        let names = &self.space.parameters()[parameter].influences;
        let is_influenced = |name: &String| names.is_empty() || names.contains(name);
        (0..self.blocks.len()).filter(|&block| is_influenced(&self.blocks[block].name)).collect()
    }

    /// The residuals, unless the evaluation failed or one is NaN or too large.
    pub(crate) fn usable<'a>(&self, evaluation: &'a Evaluation) -> Option<&'a [f64]> {
        let residuals = evaluation.as_deref()?;
        let fits = residuals.len() == self.samples();
        (fits && residuals.iter().all(|r| r.abs() <= MAX_RESIDUAL)).then_some(residuals)
    }
}
