//! From recordings to physical parameters: joint by joint, then finger by finger, then the
//! keyboard. What slow presses of keys show of it is measured, the rest is fitted to what was
//! played.
//!
//! A pass runs one [`Fit`](crate::Fit) a group, and all groups share the same replays. The state is
//! written to a file after each batch; an interrupted identification resumes from it and ends with
//! the same result.

use std::path::Path;

use etude_perform::Job;

use crate::motion::RecordedMotion;

mod error;
mod pass;
mod run;
mod setup;
mod start_values;
mod state;
mod uncertainty;

pub use error::IdentifyError;
pub use pass::{Pass, PassEnd};
pub use run::Progress;
pub use state::IdentifyConfig;
pub use uncertainty::Identified;

/// Fits the simulator to motions of one rig. The file `state` holds what is needed to resume after
/// an interruption.
///
/// # Errors
/// If there is nothing to fit, a value makes no sense, or a file cannot be read or written;
/// [`IdentifyError::Interrupted`] when the job is interrupted.
pub fn identify(
    motions: &[RecordedMotion],
    config: &IdentifyConfig,
    state: &Path,
    job: &mut Job<'_, Progress>,
) -> Result<Identified, IdentifyError> {
    let setup = setup::Setup::new(motions, config)?;
    let mut saved = state::State::open(motions, &setup.before, config, state)?;
    let air = motions.iter().any(|motion| motion.keys.is_empty());
    let keys = motions.iter().any(RecordedMotion::plays_keys);
    while let Some(pass) = pass::next(&saved.ended, &config.method, air, keys) {
        if pass == Pass::Contact {
            setup.measure(&mut saved.params);
        }
        run::run(&setup, &mut saved, pass, state, job)?;
    }
    let measured = setup.measure(&mut saved.params);
    saved.done = true;
    saved.save(state)?;
    uncertainty::with_uncertainty(&setup, saved, measured)
}
