//! What a report is made from.

use etude_stage::{PhysicalParams, StageError};

use crate::assessment::{Assessment, Replayed, replay_both};
use crate::identification::{Identified, IdentifyConfig};
use crate::motion::RecordedMotion;

/// What a report is made from.
#[derive(Clone, Copy, Debug)]
pub struct ReportInput<'a> {
    /// Motions that were fitted.
    pub fitted: &'a [RecordedMotion],
    /// Motions that were not fitted; may be empty.
    pub held_out: &'a [RecordedMotion],
    /// How the parameters were identified.
    pub config: &'a IdentifyConfig,
    /// Parameters before the fit.
    pub before: &'a PhysicalParams,
    /// Parameters after the fit.
    pub after: &'a PhysicalParams,
    /// The result of the fit.
    pub identified: &'a Identified,
    /// Errors in the motions that were fitted.
    pub fit_errors: &'a Assessment,
    /// Errors in the held-out motions.
    pub held_out_errors: &'a Assessment,
}

impl<'a> ReportInput<'a> {
    /// Replays the motions that the report compares: those held out, or without any the fitted ones
    /// that touch no key.
    ///
    /// # Errors
    /// If the simulation cannot be built.
    pub(super) fn replay(&self) -> Result<Vec<Replayed<'a>>, StageError> {
        match self.held_out {
            [] => replay_both(
                self.fitted.iter().filter(|motion| motion.keys.is_empty()),
                self.before,
                self.after,
            ),
            held_out => replay_both(held_out, self.before, self.after),
        }
    }
}
