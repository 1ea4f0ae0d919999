//! Reasons why a recorded rollout does not fit its scenario.

/// The reason why a recorded rollout does not match a scenario.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ForeignRollout {
    /// An agent is not in the scenario.
    #[error("agent `{0}` is not in the scenario")]
    Unknown(String),
    /// An agent occurs twice.
    #[error("agent `{0}` occurs twice")]
    Twice(String),
    /// The AV is missing.
    #[error("the AV `{0}` is missing")]
    NoAv(String),
}
