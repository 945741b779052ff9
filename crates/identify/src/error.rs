//! Why something cannot be fitted.

/// Parameters, residuals, evaluations or a configuration that cannot be fitted. The text says why,
/// and what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FitError(pub(crate) String);

impl FitError {
    pub(crate) fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}
