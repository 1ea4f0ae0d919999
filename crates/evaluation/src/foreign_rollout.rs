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
    /// A state is beyond the limits of scenarios.
    #[error("agent `{agent}`: `{name}` at step {step} is {value}, expected {expected}")]
    Beyond {
        /// Id of the agent.
        agent: String,
        /// Name of the value.
        name: &'static str,
        /// Step, 1 to 80.
        step: usize,
        /// The value, in the frame of the scenario.
        value: String,
        /// The expected value.
        expected: &'static str,
    },
    /// The AV is missing.
    #[error("the AV `{0}` is missing")]
    NoAv(String),
}
