//! The sections of a report, in the order in which a reader decides.

use etude_stage::{JOINTS, StageError};

use super::document::{Element, Report, Section};
use super::input::{Replayed, ReportInput};
use super::{correlation, directions, errors, overlay, parameters, remaining, summary};

impl Report {
    /// Replays the motions before and after the fit, and describes the result.
    ///
    /// # Errors
    /// If the simulation cannot be built.
    pub fn new(input: &ReportInput<'_>) -> Result<Self, StageError> {
        Ok(report(input, &input.replay()?))
    }
}

/// The report on motions that were replayed.
pub(super) fn report(input: &ReportInput<'_>, replayed: &[Replayed<'_>]) -> Report {
    let parts = remaining::parts(replayed);
    let rig = input.fitted.first().map_or("", |motion| motion.rig.name.as_str());
    let overlays = (0..JOINTS).filter_map(|joint| overlay::overlay(joint, replayed)).map(Element::Figure);
    let section = |title, elements| Section { title, elements };
    Report {
        title: format!("Identification of the rig {rig}"),
        sections: vec![
            section("In short", vec![Element::List(summary::in_short(input, &parts))]),
            section("What was fitted", summary::what_was_fitted(input)),
            section("Errors", errors::elements(input)),
            section(
                "What the simulator cannot express",
                remaining::elements(&parts, !input.held_out.is_empty()),
            ),
            section("Before and after", overlays.collect()),
            section("Parameters", parameters::elements(input)),
            section("Correlations", correlation::elements(&input.identified.estimates)),
            section("What is not identifiable", directions::elements(input.identified)),
        ],
    }
}
