//! Errors of making, reading and using references.

use std::fmt::Display;

use reactsim_formats::FormatError;

use crate::error::EvaluationError;

/// The reason why a reference cannot be made, read or used. A run that disagrees with a reference is not an
/// error but the result of a [`super::Verification`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// A reference, or a run that should become or repeat one, does not meet a requirement. The text names
    /// the folder, the file, what was found and the remedy.
    #[error("{0}")]
    Unfit(String),
    /// Files cannot be read or written, or a run is unusable.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
}

impl ReferenceError {
    /// Refuses a folder for this reason.
    pub fn unfit(place: &str, reason: impl Display) -> Self {
        Self::Unfit(format!("{place}: {reason}"))
    }
}

impl From<FormatError> for ReferenceError {
    fn from(error: FormatError) -> Self {
        Self::Evaluation(error.into())
    }
}
