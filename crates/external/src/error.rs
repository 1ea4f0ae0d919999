//! Reasons why an external simulator or planner cannot be used.

/// Error in starting or using an external simulator or planner.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ExternalError(pub String);

impl ExternalError {
    /// Returns the error of a program that does not start or does not greet.
    pub(super) fn no_start(name: &str, reason: &str) -> Self {
        Self(format!("external program `{name}` did not start: {reason}"))
    }
}
