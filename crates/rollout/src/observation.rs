//! The observations of simulators and AV policies.

use reactsim_scene::{AgentState, Frame, LightState, Start};

/// Input of a simulator or an AV policy: the start, and realised states up to the current time. It gives
/// no access to the log's future.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    start: &'a Start,
    tracks: &'a [Vec<Frame>],
    lights: &'a [Vec<Option<LightState>>],
    av_next: Option<AgentState>,
}

impl<'a> Observation<'a> {
    /// Creates an observation; `tracks` and `lights` must end at the current time.
    pub fn new(
        start: &'a Start,
        tracks: &'a [Vec<Frame>],
        lights: &'a [Vec<Option<LightState>>],
        av_next: Option<AgentState>,
    ) -> Self {
        Self { start, tracks, lights, av_next }
    }

    /// Returns the initial information of the scenario: agents, map, history.
    pub fn start(&self) -> &'a Start {
        self.start
    }

    /// Returns the index of the latest realised frame; the current frame of the scenario at first.
    #[inline]
    pub fn frame(&self) -> usize {
        self.tracks.first().map_or(self.start.current(), |t| t.len() - 1)
    }

    /// Returns the number of realised steps.
    #[inline]
    pub fn step(&self) -> usize {
        self.frame() - self.start.current()
    }

    /// Returns the realised frames of an agent, from frame 0 to now. Slot 0 is the AV.
    #[inline]
    pub fn track(&self, agent: usize) -> &'a [Frame] {
        &self.tracks[agent]
    }

    /// Returns the realised frames of all agents, from frame 0 to now.
    pub fn tracks(&self) -> &'a [Vec<Frame>] {
        self.tracks
    }

    /// Returns the current state of an agent; `None` if it is absent.
    #[inline]
    pub fn state(&self, agent: usize) -> Frame {
        self.tracks[agent].last().copied().flatten()
    }

    /// Returns the present height of the road under each agent, metres; NaN if unknown. Empty in scenarios of
    /// one level.
    pub fn heights(&self) -> Vec<f64> {
        self.start.heights_at_end(self.tracks.iter().map(Vec::as_slice))
    }

    /// Returns the state of the AV one step ahead, if the protocol provides it (Algorithm 1, line 4).
    pub fn av_next(&self) -> Option<AgentState> {
        self.av_next
    }

    /// Returns the same observation without the state of the AV one step ahead.
    pub(super) fn without_av_next(self) -> Self {
        Self { av_next: None, ..self }
    }

    /// Returns the states of a traffic light from frame 0 to now; `None` where it was not observed.
    #[inline]
    pub fn light(&self, light: usize) -> &'a [Option<LightState>] {
        &self.lights[light]
    }

    /// Returns the current state of each traffic light; `None` where it was not observed.
    pub fn lights_now(&self) -> Vec<Option<LightState>> {
        self.lights.iter().map(|states| states.last().copied().flatten()).collect()
    }
}
