//! The observations of simulators and AV policies.

use std::sync::{Mutex, PoisonError};

use reactsim_scene::levels::RoadHeights;
use reactsim_scene::{AgentState, Frame, LightState, Start};

/// Input of a simulator or an AV policy: the start, and realised states up to the current time. It gives
/// no access to the log's future.
#[derive(Clone, Copy, Debug)]
pub struct Observation<'a> {
    start: &'a Start,
    tracks: &'a [Vec<Frame>],
    lights: &'a [Vec<Option<LightState>>],
    av_next: Option<AgentState>,
    /// Steps that were realised before the current frame of `start`.
    first_step: usize,
    changes: usize,
    /// Heights of the agents up to an earlier time; `None`: they are looked up from the start on.
    heights: Option<&'a Mutex<RoadHeights>>,
}

impl<'a> Observation<'a> {
    /// Creates an observation; `tracks` and `lights` must end at the current time.
    pub fn new(
        start: &'a Start,
        tracks: &'a [Vec<Frame>],
        lights: &'a [Vec<Option<LightState>>],
        av_next: Option<AgentState>,
    ) -> Self {
        Self { start, tracks, lights, av_next, first_step: 0, changes: 0, heights: None }
    }

    /// Returns the observation with the heights of the rollout so far.
    pub(super) fn with_heights(self, heights: &'a Mutex<RoadHeights>) -> Self {
        Self { heights: Some(heights), ..self }
    }

    /// Returns the observation of a rollout that had realised `first_step` steps at the current frame of
    /// `start`, which was renewed `changes` times.
    pub(super) fn continued(self, first_step: usize, changes: usize) -> Self {
        Self { first_step, changes, ..self }
    }

    /// Returns the initial information: agents, map, history. When agents enter or leave, or the horizon of a
    /// simulator is over, slots change, and the current frame of the start is the one of the change.
    pub fn start(&self) -> &'a Start {
        self.start
    }

    /// Returns the index of the latest realised frame; the current frame of the start at first.
    #[inline]
    pub fn frame(&self) -> usize {
        self.tracks.first().map_or(self.start.current(), |t| t.len() - 1)
    }

    /// Returns the number of realised steps of the rollout.
    #[inline]
    pub fn step(&self) -> usize {
        self.first_step + self.frame() - self.start.current()
    }

    /// Returns how often the start was renewed so far, because agents entered or left, or the horizon was
    /// over. While it stays the same, so does the start.
    #[inline]
    pub fn changes(&self) -> usize {
        self.changes
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
        match self.heights {
            Some(known) => {
                known.lock().unwrap_or_else(PoisonError::into_inner).at_end(self.start, self.tracks)
            }
            None => RoadHeights::default().at_end(self.start, self.tracks),
        }
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
