//! Motion that is known in full.

use reactsim_scene::{Frame, LightState, Start};

use super::view::SceneView;

/// Known motion: a rollout or a log.
#[derive(Clone, Copy, Debug)]
pub struct KnownMotion<'a> {
    /// Agents and map.
    pub start: &'a Start,
    /// Frames of each agent.
    pub tracks: &'a [Vec<Frame>],
    /// State of each light per frame.
    pub lights: &'a [Vec<Option<LightState>>],
    /// Whether agents see the AV one frame ahead.
    pub av_lookahead: bool,
}

impl KnownMotion<'_> {
    /// Returns the state of each light at a frame.
    pub fn lights_at(&self, frame: usize) -> Vec<Option<LightState>> {
        self.lights.iter().map(|l| l.get(frame).copied().flatten()).collect()
    }

    /// Returns the scene at a frame as agents see it, with the states of the lights at this frame.
    pub fn view<'a>(&'a self, now: usize, lights: &'a [Option<LightState>]) -> SceneView<'a> {
        let next = self.tracks.first().and_then(|av| av.get(now + 1).copied().flatten());
        let av_next = next.filter(|_| self.av_lookahead);
        SceneView {
            agents: &self.start.agents,
            tracks: self.tracks,
            now,
            first: 0,
            av_next,
            lights,
            start: Some(self.start),
            heights: None,
        }
    }
}
