//! A scene up to a frame, as visible to a simulator.

use reactsim::scene::{Agent, AgentState, Frame, LightState};

use super::body::Body;
use super::lane::CandidatePath;
use super::places::Places;

/// A scene up to a frame, as visible to a simulator.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SceneView<'a> {
    /// Agents; slot 0 is the AV.
    pub agents: &'a [Agent],
    /// Their realized frames; frames after `now` are ignored.
    pub tracks: &'a [Vec<Frame>],
    /// The frame of the step.
    pub now: usize,
    /// State of the AV one frame later, if the protocol shows it.
    pub av_next: Option<AgentState>,
    /// State of each light at `now`.
    pub lights: &'a [Option<LightState>],
}

impl SceneView<'_> {
    /// Describes an agent among these places, with its candidate paths, its own course first. `None` if
    /// it is absent or has no class.
    pub(crate) fn body(&self, slot: usize, places: &Places) -> Option<(Body, Vec<CandidatePath>)> {
        let next = if slot == 0 { self.av_next } else { None };
        Body::at(&self.agents[slot], &self.tracks[slot], self.now, slot == 0, next, places)
    }
}
