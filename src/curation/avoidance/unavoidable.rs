//! Why a conflict can not be avoided.

/// Why there is no certificate: the agent, and what stands against its response.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Unavoidable {
    /// The candidate is not 81 finite states.
    #[error("the candidate has {found} finite states, expected 81 (steps 0 to 80)")]
    Malformed {
        /// Finite states found.
        found: usize,
    },
    /// The conflict is there before anybody can react.
    #[error("agent `{agent}` meets the AV at step {step}, before it can react (step {reaction})")]
    TooEarly {
        /// The agent.
        agent: String,
        /// Step of the conflict.
        step: usize,
        /// Step up to which everybody moves as in the log.
        reaction: usize,
    },
    /// The hardest braking is too late, and so is the hardest acceleration.
    #[error("agent `{agent}` can neither stop for {other} nor pass it: they meet at step {step}")]
    TooClose {
        /// The agent.
        agent: String,
        /// Whom it meets: `the AV` or an agent.
        other: String,
        /// Step at which the braking agent meets it.
        step: usize,
    },
    /// What is possible against each of several is not possible against all of them.
    #[error("agent `{agent}` is hemmed in: no speed profile keeps clear of all of {between}")]
    HemmedIn {
        /// The agent.
        agent: String,
        /// Who blocks its path: `the AV` and agents.
        between: String,
    },
    /// The agent has left the log before it could respond.
    #[error("agent `{agent}` is no longer in the log when it could react")]
    Absent {
        /// The agent.
        agent: String,
    },
    /// The agent stands throughout its log: nobody is in it who would drive off.
    #[error("agent `{agent}` stands throughout its log and can not make way")]
    Standing {
        /// The agent.
        agent: String,
    },
    /// An agent behind one that brakes, or shifts, can not do likewise.
    #[error("agent `{agent}` runs into agent `{leader}`, which makes way for the AV: {reason}")]
    Follower {
        /// The agent.
        agent: String,
        /// Whose response it runs into.
        leader: String,
        /// Why.
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

impl Unavoidable {
    /// A short name for tallies.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Malformed { .. } => "malformed",
            Self::TooEarly { .. } => "too-early",
            Self::TooClose { .. } => "too-close",
            Self::HemmedIn { .. } => "hemmed-in",
            Self::Absent { .. } => "absent",
            Self::Standing { .. } => "standing",
            Self::Follower { .. } => "follower",
            Self::TooMany { .. } => "too-many",
            Self::Unsettled { .. } => "unsettled",
            Self::Check { .. } => "check",
        }
    }
}
