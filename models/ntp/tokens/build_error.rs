//! Reasons why a vocabulary cannot be built.

use reactsim_nn::WeightsError;
use reactsim_nn::perception::Class;

/// Error from building a vocabulary.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A class has too little data.
    #[error(
        "class `{class}`: {segments} different motions are too few for `{method}`, which needs {needed}; \
         give more scenarios, or take kinematic tokens for it with --fill"
    )]
    NoData {
        /// Class without enough data.
        class: Class,
        /// Number of motions of the class.
        segments: usize,
        /// Name of the builder.
        method: &'static str,
        /// Data that the builder needs.
        needed: String,
    },
    /// A setting is out of range.
    #[error("setting `{name}` of `{method}` is {value}, expected {expected}")]
    Setting {
        /// Name of the builder.
        method: &'static str,
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// The tokens do not form a vocabulary.
    #[error(transparent)]
    Vocabulary(#[from] WeightsError),
}
