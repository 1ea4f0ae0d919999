//! Step 2: candidates and their sources.

use reactsim_formats::Cause;
use reactsim_rollout::Stream;
use reactsim_scene::{AgentState, Deviation, Scenario};

/// A trajectory that the AV might have driven.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Id of the source that proposed it.
    pub source: String,
    /// Number of its random stream among the candidates of the scenario, from 0.
    pub number: u32,
    /// Category that the source intended, if any.
    pub intent: Option<Deviation>,
    /// Short description of the maneuver for reviewers, such as `stop: 3.1 m/s² after 0.8 s`.
    pub maneuver: String,
    /// States in the scenario frame, one more than the scenario has steps: step 0 is the AV's recorded
    /// current state, the others are driven from it.
    pub track: Vec<AgentState>,
}

impl Candidate {
    /// Returns the states at the steps from 1 on.
    pub fn future(&self) -> &[AgentState] {
        &self.track[1..]
    }
}

/// A trajectory that a source proposes for one random stream.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// Intended category, if any.
    pub intent: Option<Deviation>,
    /// Short description of the maneuver.
    pub maneuver: String,
    /// States at the steps of the scenario from 1 on, in the scenario frame.
    pub future: Vec<AgentState>,
}

/// Reason why a source proposes nothing, such as `no lane to change to`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct NoProposal(pub String);

/// A source of AV trajectories, for example a sampling planner that runs once per stream.
pub trait CandidateSource: Sync {
    /// Returns the name used in files and settings.
    fn id(&self) -> &'static str;

    /// Refuses a scenario if what the source knows about it is damaged or meant for another one.
    ///
    /// # Errors
    /// [`Cause`] names the part.
    fn check(&self, _scenario: &Scenario) -> Result<(), Cause> {
        Ok(())
    }

    /// Returns at most one proposal per stream; the same streams give the same proposals. All streams of a
    /// scenario come in one call, so that shared work is done once.
    fn propose(&self, scenario: &Scenario, streams: &mut [Stream]) -> Vec<Result<Proposal, NoProposal>>;
}
