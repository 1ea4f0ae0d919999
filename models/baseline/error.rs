//! Reasons why a baseline cannot be built or its parameters are refused.

use std::error::Error;

use super::CardError;

/// Error from building a baseline.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The card cannot be read, or a parameter is invalid.
    #[error(transparent)]
    Card(#[from] CardError),
    /// The ranges of the parameters cannot be read.
    #[error("the ranges of `{id}` cannot be read: {source}")]
    Ranges {
        /// Id of the baseline.
        id: &'static str,
        /// Cause, with line and column.
        source: toml::de::Error,
    },
    /// The entry of a parameter in the ranges is invalid.
    #[error("the range of `{key}` of `{id}` cannot be read: {source}")]
    Range {
        /// Id of the baseline.
        id: &'static str,
        /// Dotted path of the parameter.
        key: String,
        /// Cause.
        source: Box<toml::de::Error>,
    },
    /// The ranges have no entry for a parameter.
    #[error("the parameter `{key}` of `{id}` has no range: add one to its file of ranges")]
    NoRange {
        /// Id of the baseline.
        id: &'static str,
        /// Dotted path of the parameter.
        key: String,
    },
    /// A value is not within the range of its parameter.
    #[error("{id}: `{key}` is {value}, expected {range}")]
    OutOfRange {
        /// Id of the baseline.
        id: &'static str,
        /// Dotted path of the parameter.
        key: String,
        /// The value, as it was given.
        value: String,
        /// The range, with its unit.
        range: String,
    },
    /// Two parameters do not fit together.
    #[error("{id}: `{lower}` is {lower_value}, expected at most `{upper}`, which is {upper_value}")]
    Order {
        /// Id of the baseline.
        id: &'static str,
        /// Dotted path of the parameter that may not be the larger one.
        lower: &'static str,
        /// Its value.
        lower_value: f64,
        /// Dotted path of the parameter that may not be the smaller one.
        upper: &'static str,
        /// Its value.
        upper_value: f64,
    },
    /// The baseline needs weights and has none.
    #[error(
        "the simulator `{id}` needs weights, which do not ship with the program: \
         give `model-weights` {id}=FILE"
    )]
    NoWeights {
        /// Id of the baseline.
        id: &'static str,
    },
    /// The baseline replays the log or already plans with the stage, so no stage can follow it.
    #[error("no stage can follow the simulator `{id}`: it replays the log or already contains the stage")]
    TakesNoStage {
        /// Id of the baseline.
        id: &'static str,
    },
    /// Weights were given to a baseline that needs none.
    #[error("the simulator `{id}` has no weights: omit the file {file}")]
    UnexpectedWeights {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
    },
    /// The digest of the file differs from the one in the manifest.
    #[error(
        "the weights {file} of `{id}` have the SHA-256 {found}, but the manifest lists {expected}: \
         the file is damaged or of another version; get the listed file, or rename yours"
    )]
    DigestMismatch {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
        /// Digest in the manifest.
        expected: String,
        /// Digest of the file.
        found: String,
    },
    /// The weights cannot be used.
    #[error("the weights {file} of `{id}` cannot be used: {source}")]
    Weights {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
        /// Cause: the tensor and how to fix it.
        source: Box<dyn Error + Send + Sync>,
    },
    /// There is no such parameter.
    #[error("`{id}` has no parameter `{key}`; {known}")]
    UnknownParameter {
        /// Id of the baseline.
        id: &'static str,
        /// Dotted path of the parameter.
        key: String,
        /// List of the parameters that exist.
        known: String,
    },
    /// The value has another type than the default one.
    #[error(
        "`{value}` is not a valid `{key}` for `{id}`: expected a value of type {expected}, such as {like}"
    )]
    WrongParameter {
        /// Id of the baseline.
        id: &'static str,
        /// Dotted path of the parameter.
        key: String,
        /// Value that was given.
        value: String,
        /// Present value.
        like: String,
        /// Type of the present value.
        expected: &'static str,
    },
    /// The manifest of weights cannot be read.
    #[error("the manifest of weights cannot be read: {0}")]
    Manifest(toml::de::Error),
    /// The manifest lists a file as shipped that is not part of the program.
    #[error(
        "the manifest lists the weights {file} of `{id}` as shipped, but they are not part of the program"
    )]
    NotEmbedded {
        /// Id of the baseline.
        id: &'static str,
        /// The file.
        file: String,
    },
}
