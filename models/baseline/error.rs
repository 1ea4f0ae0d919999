//! Reasons why a baseline cannot be built or its parameters are refused.

use std::error::Error;

/// Error from building a baseline.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
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
    /// The baseline replays the log or already plans with the stage, so no stage can follow it.
    #[error("no stage can follow the simulator `{id}`: it replays the log or already contains the stage")]
    TakesNoStage {
        /// Id of the baseline.
        id: &'static str,
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
    /// Any other reason: the text names the baseline, what was found and the remedy.
    #[error("{0}")]
    Refused(String),
}
