//! Reasons why a policy cannot be read.

use reactsim_nn::WeightsError;

use super::super::tokens::VocabularyError;

/// Error from reading a policy.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// Invalid tensors or configuration.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// Invalid vocabulary.
    #[error(transparent)]
    Vocabulary(#[from] VocabularyError),
    /// A size is out of range.
    #[error("the file's configuration has {field} = {value}, expected {expected}")]
    Size {
        /// Name of the field.
        field: &'static str,
        /// Value of the field.
        value: f64,
        /// Allowed values.
        expected: &'static str,
    },
}

/// Name of this kind of network in the configuration of a file.
pub(super) const KIND: &str = "reactive";
