//! What a report is made from.

use etude_stage::{PhysicalParams, StageConfig, StageError};

use crate::assessment::Assessment;
use crate::identification::{Identified, IdentifyConfig};
use crate::motion::Motion;
use crate::replay::{Replayer, Trace};

/// What a report is made from.
#[derive(Clone, Copy, Debug)]
pub struct ReportInput<'a> {
    /// Motions that were fitted.
    pub fitted: &'a [Motion],
    /// Motions that were not fitted; may be empty.
    pub held_out: &'a [Motion],
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

/// A motion and its replays before and after the fit. A replay is `None` where the simulation diverged.
pub(super) struct Replayed<'a> {
    pub motion: &'a Motion,
    pub traces: [Option<Trace>; 2],
}

impl<'a> ReportInput<'a> {
    /// Replays the motions that the report compares: those held out, or without any the fitted ones that touch no key.
    ///
    /// # Errors
    /// If the simulation cannot be built.
    pub(super) fn replay(&self) -> Result<Vec<Replayed<'a>>, StageError> {
        let motions: Vec<&Motion> = match self.held_out {
            [] => self.fitted.iter().filter(|motion| motion.keys.is_empty()).collect(),
            held_out => held_out.iter().collect(),
        };
        let Some(first) = motions.first() else { return Ok(Vec::new()) };
        let mut replayer = Replayer::new(&StageConfig { side: first.side(), ..StageConfig::default() })?;
        let both = |motion: &'a Motion| Replayed {
            motion,
            traces: [self.before, self.after].map(|params| replayer.replay(params, motion, false)),
        };
        Ok(motions.into_iter().map(both).collect())
    }
}
