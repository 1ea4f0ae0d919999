//! The proof that a conflict can be avoided: a response of every agent that the candidate disturbs.

use crate::scene::AgentState;

/// Responses with which nobody touches the AV, or comes within half a second of it: a perfect simulator has no collision and no risky
/// approach here.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Certificate {
    /// One response per agent that does not simply replay its log, in the order of the agents.
    pub responses: Vec<Response>,
}

/// How one agent gets out of the AV's way.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// Id of the agent.
    pub agent: String,
    /// Step up to which the agent moves as in its log: the deviation becomes visible and 0.3 s pass.
    pub reaction_step: usize,
    /// Sideways shift from the logged path, metres, left positive; 0 for a response by speed alone.
    pub nudge: f64,
    /// Hardest braking, m/s² (not negative).
    pub peak_deceleration: f64,
    /// Smallest distance between the boxes of agent and AV (rounded, as the metrics take them), metres.
    pub clearance: f64,
    /// 81 states: the steps 0 to 80.
    pub track: Vec<AgentState>,
}

impl Certificate {
    /// The hardest braking of all responses, m/s²; 0 without responses.
    pub fn peak_deceleration(&self) -> f64 {
        self.responses.iter().fold(0.0, |a, r| a.max(r.peak_deceleration))
    }
}
