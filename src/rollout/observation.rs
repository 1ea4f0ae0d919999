//! What may be seen.

use crate::scene::{AgentState, CURRENT, Frame, LightState, Start};

/// What a simulator or an AV policy sees: the start, and realised states up to now. Nothing leads from here to the log's future.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    start: &'a Start,
    tracks: &'a [Vec<Frame>],
    lights: &'a [Vec<Option<LightState>>],
    av_next: Option<AgentState>,
}

impl<'a> Observation<'a> {
    /// `tracks` and `lights` hold the frames up to now and no more.
    pub(super) fn new(
        start: &'a Start,
        tracks: &'a [Vec<Frame>],
        lights: &'a [Vec<Option<LightState>>],
        av_next: Option<AgentState>,
    ) -> Self {
        Self { start, tracks, lights, av_next }
    }

    /// What was known at the current frame: agents, map, history.
    pub fn start(&self) -> &'a Start {
        self.start
    }

    /// Index of the latest realised frame, 10 to 89.
    pub fn frame(&self) -> usize {
        self.tracks.first().map_or(CURRENT, |t| t.len() - 1)
    }

    /// Number of realised steps, 0 to 79.
    pub fn step(&self) -> usize {
        self.frame() - CURRENT
    }

    /// The realised frames of an agent, from frame 0 to now. Slot 0 is the AV.
    pub fn track(&self, agent: usize) -> &'a [Frame] {
        &self.tracks[agent]
    }

    /// The state of an agent now; `None` where it is absent.
    pub fn state(&self, agent: usize) -> Frame {
        self.tracks[agent].last().copied().flatten()
    }

    /// The AV one step ahead, where the protocol allows it (Algorithm 1, line 4).
    pub fn av_next(&self) -> Option<AgentState> {
        self.av_next
    }

    /// The states that a light has shown, from frame 0 to now; `None` where it was not observed.
    pub fn light(&self, light: usize) -> &'a [Option<LightState>] {
        &self.lights[light]
    }
}
