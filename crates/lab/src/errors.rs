//! Errors that callers distinguish, and messages that several functions share.

use std::fmt::Display;
use std::path::Path;

use anyhow::anyhow;
use etude_identify::IdentifyError;
use etude_perform::PerformError;
use etude_perform::session::Session;

/// The work was interrupted on request. The text says what is kept.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Interrupted(pub String);

impl Interrupted {
    /// Work that the same command resumes.
    pub(crate) fn resumable() -> Self {
        Self("interrupted; the same command resumes".to_string())
    }

    /// Whether this is the reason of `error`.
    pub fn is_cause_of(error: &anyhow::Error) -> bool {
        error.is::<Self>()
            || matches!(error.downcast_ref(), Some(IdentifyError::Interrupted))
            || matches!(error.downcast_ref(), Some(PerformError::Interrupted))
    }
}

/// The error of a folder or file in it that cannot be used.
pub(crate) fn unusable(path: &Path, why: impl Display) -> anyhow::Error {
    anyhow!("{}: {why}; choose another folder with -o", path.display())
}

/// A safety stop ended the work. The text says in which part, and why.
#[derive(Debug, thiserror::Error)]
#[error("{0}; remove the cause, then give the same command again")]
pub struct SafetyStop(String);

/// The error of a safety stop.
pub(crate) fn safety_stop(part: &str, fault: &str) -> anyhow::Error {
    SafetyStop(format!("{part}: safety stop: {fault}")).into()
}

/// Releases the robot of `session` after `outcome`. Neither an error of the release nor what came
/// before it hides the other: the operator must use the hardware stop, and know why.
///
/// # Errors
/// That of `outcome`, and that of the release.
pub fn released<T>(session: &mut Session, outcome: anyhow::Result<T>) -> anyhow::Result<T> {
    match (outcome, session.let_go()) {
        (outcome, Ok(())) => outcome,
        (Ok(_), Err(why)) => Err(match session.robot.fault() {
            Some(fault) => anyhow!("{fault}").context(why),
            None => anyhow!(why),
        }),
        (Err(error), Err(why)) => Err(error.context(why)),
    }
}
