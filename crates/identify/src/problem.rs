//! What is minimised: the residuals of a candidate in blocks, and their cost.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::space::Space;

/// A residual beyond this counts as a failure: its square and its differences would leave the range of
/// numbers.
const LARGEST_RESIDUAL: f64 = 1e100;

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
    /// Half its square up to this many standard deviations of the noise, in proportion beyond (Huber 1964).
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

/// The evaluation of a candidate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Evaluation {
    /// Residuals of all blocks, one block after the other, divided by the standard deviation of the noise.
    Residuals(Vec<f64>),
    /// It failed, for example because the simulation diverged. The text is the reason.
    Failed(String),
}

/// An invalid problem.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProblemError {
    /// No residuals.
    #[error("there is no residual; give at least one block with at least one sample")]
    Empty,
    /// Two blocks have the same name.
    #[error("two blocks of residuals are called `{0}`; give each its own name")]
    Twice(String),
    /// A parameter influences an unknown block.
    #[error("parameter `{path}` influences block `{block}`, which does not exist; the blocks are: {blocks}")]
    Unknown {
        /// Path of the parameter.
        path: String,
        /// Name of the missing block.
        block: String,
        /// Names of the blocks there are.
        blocks: String,
    },
    /// The Huber loss's bend is not positive.
    #[error("the Huber loss bends at {0} standard deviations; give a positive number, such as 1.345")]
    Bend(f64),
}

/// Parameters, blocks of residuals and the loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Parts", into = "Parts")]
pub struct Problem {
    parts: Parts,
    /// Place of each block in the residuals.
    ranges: Vec<Range<usize>>,
    /// Per parameter, the blocks that it influences, in order.
    influences: Vec<Vec<usize>>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    space: Space,
    blocks: Vec<Block>,
    loss: Loss,
}

impl TryFrom<Parts> for Problem {
    type Error = ProblemError;

    fn try_from(parts: Parts) -> Result<Self, ProblemError> {
        Self::new(parts.space, parts.blocks, parts.loss)
    }
}

impl From<Problem> for Parts {
    fn from(problem: Problem) -> Self {
        problem.parts
    }
}

impl Problem {
    /// A problem.
    ///
    /// # Errors
    /// If blocks, loss and the parameters' influences do not match.
    pub fn new(space: Space, blocks: Vec<Block>, loss: Loss) -> Result<Self, ProblemError> {
        let mut ranges = Vec::with_capacity(blocks.len());
        let mut end = 0usize;
        for (index, block) in blocks.iter().enumerate() {
            if block.samples == 0 {
                return Err(ProblemError::Empty);
            }
            if blocks[..index].iter().any(|other| other.name == block.name) {
                return Err(ProblemError::Twice(block.name.clone()));
            }
            let start = end;
            // Saturates only with a damaged file.
            end = end.saturating_add(block.samples);
            ranges.push(start..end);
        }
        if ranges.is_empty() {
            return Err(ProblemError::Empty);
        }
        if let Loss::Huber(bend) = loss
            && !(bend > 0.0 && bend.is_finite())
        {
            return Err(ProblemError::Bend(bend));
        }
        let mut influences = Vec::with_capacity(space.len());
        for parameter in space.parameters() {
            let mut places = Vec::new();
            for name in &parameter.influences {
                let place = blocks.iter().position(|block| block.name == *name).ok_or_else(|| {
                    let names: Vec<&str> = blocks.iter().map(|block| block.name.as_str()).collect();
                    let (path, block) = (parameter.path.clone(), name.clone());
                    ProblemError::Unknown { path, block, blocks: names.join(", ") }
                })?;
                places.push(place);
            }
            places.sort_unstable();
            places.dedup();
            if places.is_empty() {
                places = (0..blocks.len()).collect();
            }
            influences.push(places);
        }
        Ok(Self { parts: Parts { space, blocks, loss }, ranges, influences })
    }

    /// The parameters.
    pub fn space(&self) -> &Space {
        &self.parts.space
    }

    /// The blocks of residuals, in order.
    pub fn blocks(&self) -> &[Block] {
        &self.parts.blocks
    }

    /// The loss.
    pub fn loss(&self) -> Loss {
        self.parts.loss
    }

    /// Number of residuals of a candidate.
    pub fn samples(&self) -> usize {
        self.ranges.last().map_or(0, |range| range.end)
    }

    /// Place of each block in the residuals.
    pub fn ranges(&self) -> &[Range<usize>] {
        &self.ranges
    }

    /// Cost of residuals: the sum of the losses. With the squared loss and pure noise it is half their
    /// number.
    pub fn cost(&self, residuals: &[f64]) -> f64 {
        residuals.iter().map(|&r| self.loss().cost(r)).sum()
    }

    /// Blocks that a parameter influences, in order.
    pub(crate) fn influenced(&self, parameter: usize) -> &[usize] {
        self.influences.get(parameter).map_or(&[], Vec::as_slice)
    }

    /// The residuals, unless the evaluation failed or one is NaN or too large.
    pub(crate) fn usable<'a>(&self, evaluation: &'a Evaluation) -> Option<&'a [f64]> {
        match evaluation {
            Evaluation::Residuals(residuals)
                if residuals.len() == self.samples()
                    && residuals.iter().all(|r| r.abs() <= LARGEST_RESIDUAL) =>
            {
                Some(residuals)
            }
            _ => None,
        }
    }
}
