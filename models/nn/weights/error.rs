//! Errors of weights files.

use crate::SizeError;

/// Reason why a file is rejected: weights, or a vocabulary or intention points, which may be stored with
/// them. Shapes are as in the file: linear weights are [out, in].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WeightsError {
    /// The file is cut short or has another format.
    #[error("the file is cut short or not safetensors ({0}): export it again")]
    Format(#[from] safetensors::SafeTensorError),
    /// The configuration in the file's metadata is missing or does not fit.
    #[error("the file's metadata has no usable `config`: {0}")]
    Config(String),
    /// A size of the network is out of range.
    #[error(transparent)]
    Size(#[from] SizeError),
    /// Any other reason. The text names the tensor, what was found, and the remedy.
    #[error("{0}")]
    Refused(String),
}
