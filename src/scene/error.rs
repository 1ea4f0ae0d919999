//! The error of an invalid scenario.

/// The reason why parts do not form a scenario. The text names the field and the value; formats add file and
/// record.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("scenario `{scenario}`: {field} is {value}, expected {expected}")]
pub struct SceneError {
    /// Id of the scenario, possibly empty.
    pub scenario: String,
    /// Path of the field, such as `agents[3].track[17].x`.
    pub field: String,
    /// The value found.
    pub value: String,
    /// The expected value.
    pub expected: String,
}
