//! The sections of a report, in the order in which a reader decides.

use etude_stage::{DRIVEN_JOINTS, StageError};

use super::document::{Figure, Report, escape, list};
use super::input::ReportInput;
use super::{correlation, directions, errors, overlay, parameters, remaining_error, summary};
use crate::assessment::Replayed;

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
    let parts = remaining_error::parts(replayed);
    let rig = input.fitted.first().map_or("", |motion| motion.rig_label.as_str());
    let figures: Vec<Figure> =
        (0..DRIVEN_JOINTS).filter_map(|joint| overlay::overlay(joint, replayed)).collect();
    let sections = [
        ("In short", vec![list(&summary::in_short(input, &parts))]),
        ("What was fitted", summary::what_was_fitted(input)),
        ("Errors", errors::elements(input)),
        ("What the simulator cannot express", remaining_error::elements(&parts, !input.held_out.is_empty())),
        ("Before and after", figures.iter().map(Figure::markdown).collect()),
        ("Parameters", parameters::elements(input)),
        ("Correlations", correlation::elements(&input.identified.estimates)),
        ("What is not identifiable", directions::elements(input.identified)),
    ];
    let mut markdown = format!("# Identification of the rig {}\n", escape(rig));
    for (title, elements) in sections {
        markdown += &format!("\n## {title}\n");
        for element in elements {
            markdown += &format!("\n{element}");
        }
    }
    Report { markdown, figures }
}
