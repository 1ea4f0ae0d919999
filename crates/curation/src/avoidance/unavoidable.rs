//! Reasons why a conflict cannot be avoided.

/// Reason why there is no certificate: the agent, and what prevents its response.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Unavoidable {
    /// The candidate does not have a finite state at each step of the scenario.
    #[error("the candidate has {found} finite states, expected {expected}, one per step from 0 on")]
    Malformed {
        /// Finite states found.
        found: usize,
        /// States expected.
        expected: usize,
    },
    /// The conflict occurs before anybody can react.
    #[error("agent `{agent}` meets the AV at step {step}, before it can react (step {reaction})")]
    TooEarly {
        /// The agent.
        agent: String,
        /// Step of the conflict.
        step: usize,
        /// Last step up to which everybody moves as in the log.
        reaction: usize,
    },
    /// The hardest braking is too late, and so is the hardest acceleration.
    #[error("agent `{agent}` can neither stop for {other} nor pass it: they meet at step {step}")]
    TooClose {
        /// The agent.
        agent: String,
        /// The other party: `the AV` or an agent.
        other: String,
        /// Step at which the braking agent meets it.
        step: usize,
    },
    /// Each of several conflicts can be avoided, but not all of them together.
    #[error("agent `{agent}` is hemmed in: no speed profile keeps clear of all of {between}")]
    HemmedIn {
        /// The agent.
        agent: String,
        /// The parties that block its path: `the AV` and agents.
        between: String,
    },
    /// The agent has left the log before it could respond.
    #[error("agent `{agent}` is no longer in the log when it could react")]
    Absent {
        /// The agent.
        agent: String,
    },
    /// The agent is stationary throughout its log: its driver may be absent.
    #[error("agent `{agent}` stands throughout its log and can not make way")]
    Standing {
        /// The agent.
        agent: String,
    },
    /// An agent behind one that brakes, or shifts, cannot do the same.
    #[error("agent `{agent}` runs into agent `{leader}`, which makes way for the AV: {reason}")]
    Follower {
        /// The agent.
        agent: String,
        /// The agent whose response it runs into.
        leader: String,
        /// The reason.
        reason: Box<Unavoidable>,
    },
    /// Too many agents would have to respond.
    #[error("more than {limit} agents would have to respond")]
    TooMany {
        /// The bound.
        limit: usize,
    },
    /// The responses found disturb each other again and again.
    #[error("the responses found for agent `{agent}` and others disturb each other")]
    Unsettled {
        /// The agent.
        agent: String,
    },
    /// The scene with all responses does not pass the metrics.
    #[error("with all responses agent `{agent}` is still counted by `{metric}` at step {step}")]
    Check {
        /// The agent.
        agent: String,
        /// Id of the metric.
        metric: String,
        /// The first such step.
        step: usize,
    },
}
