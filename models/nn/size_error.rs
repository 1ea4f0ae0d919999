//! Error of a network's configuration.

/// Error of a size that is out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("the configuration of the network has {field} = {value}, expected {expected}")]
pub struct SizeError {
    /// Field.
    pub field: &'static str,
    /// Value.
    pub value: f64,
    /// Accepted values.
    pub expected: &'static str,
}
