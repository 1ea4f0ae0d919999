//! Step 2: candidates, and what proposes them.

use crate::rollout::Stream;
use crate::scene::{AgentState, Deviation, FUTURE, Scenario};

/// States of a candidate: the steps 0 to 80.
pub const CANDIDATE_STATES: usize = FUTURE + 1;

/// A trajectory that the AV might have driven.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Id of the source that proposed it.
    pub source: String,
    /// Number of its random stream among the candidates of the scenario, from 0.
    pub number: u32,
    /// What the source meant to do, where it means anything.
    pub intent: Option<Deviation>,
    /// What the AV does, in a few words for a reviewer, such as `stop: 3.1 m/s² after 0.8 s`.
    pub maneuver: String,
    /// 81 states, in the scenario frame: step 0 is the AV's recorded current state, the others are driven from it.
    pub track: Vec<AgentState>,
}

impl Candidate {
    /// The states at the steps 1 to 80.
    pub fn future(&self) -> &[AgentState] {
        &self.track[1..]
    }
}

/// What a source proposes for one random stream.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// What is meant, where anything is.
    pub intent: Option<Deviation>,
    /// In a few words.
    pub maneuver: String,
    /// States at the steps 1 to 80, in the scenario frame.
    pub future: Vec<AgentState>,
}

/// Why a source proposes nothing, such as `no lane to change to`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct NoProposal(pub String);

/// Proposes trajectories of the AV. A planner that samples is one: it runs once for every stream.
pub trait CandidateSource: Sync {
    /// Name in files and settings.
    fn id(&self) -> &'static str;

    /// One proposal for every stream; the same streams give the same proposals. A scenario as a whole is handed over so that work for
    /// all streams is done once.
    fn propose(&self, scenario: &Scenario, streams: &mut [Stream]) -> Vec<Result<Proposal, NoProposal>>;
}
