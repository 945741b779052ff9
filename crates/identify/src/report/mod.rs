//! The report of an identification, for whoever decides whether to trust its numbers: a page and a text that
//! say the same.
//!
//! The sections are in `sections`; each is made of elements of a `document`, which `html` and `text` render.

mod advice;
mod chart;
mod correlation;
mod document;
mod errors;
mod held;
pub mod html;
mod number;
mod overlay;
mod parameters;
mod sections;
mod text;
mod unexplained;
mod weak;
mod what_is_left;

#[cfg(test)]
mod tests;

use etude_stage::{PhysicalParams, StageConfig, StageError};

use crate::assessment::Assessment;
use crate::identification::{Identified, IdentifyConfig};
use crate::motion::Motion;
use crate::replay::Replayer;
use document::Document;
use overlay::Replayed;

/// What a report is made of.
#[derive(Clone, Copy, Debug)]
pub struct ReportInput<'a> {
    /// Motions that were fitted.
    pub fitted: &'a [Motion],
    /// Motions that the fit was tried on and never fitted to; may be empty.
    pub held_out: &'a [Motion],
    /// How it was identified.
    pub config: &'a IdentifyConfig,
    /// The simulator before the fit.
    pub before: &'a PhysicalParams,
    /// The identified simulator.
    pub after: &'a PhysicalParams,
    /// What came of the fit.
    pub identified: &'a Identified,
    /// Errors in the motions that were fitted.
    pub fit_errors: &'a Assessment,
    /// Errors in the others.
    pub held_out_errors: &'a Assessment,
}

/// What was fitted, how well the simulator now repeats the robot, what it cannot express, and what each
/// number is worth (issue 5, "A report").
#[derive(Clone, Debug)]
pub struct Report {
    document: Document,
}

impl Report {
    /// Replays every motion before and after the fit, and writes up what came of it.
    ///
    /// # Errors
    /// If the world cannot be built.
    pub fn new(input: &ReportInput<'_>) -> Result<Self, StageError> {
        let [fitted, held_out] =
            [input.fitted, input.held_out].map(|motions| replay(motions, [input.before, input.after]));
        Ok(Self { document: sections::document(input, &fitted?, &held_out?) })
    }

    /// The report as one HTML page that needs no other file, no script and no network.
    pub fn html(&self) -> String {
        html::html(&self.document)
    }

    /// The same without pictures, in lines of 110 columns.
    pub fn text(&self) -> String {
        text::text(&self.document)
    }
}

fn replay<'a>(motions: &'a [Motion], worlds: [&PhysicalParams; 2]) -> Result<Vec<Replayed<'a>>, StageError> {
    let Some(first) = motions.first() else { return Ok(Vec::new()) };
    let mut replayer = Replayer::new(&StageConfig { side: first.side(), ..StageConfig::default() })?;
    let both = |motion: &'a Motion| Replayed {
        motion,
        traces: worlds.map(|params| replayer.replay(params, motion, false)),
    };
    Ok(motions.iter().map(both).collect())
}
