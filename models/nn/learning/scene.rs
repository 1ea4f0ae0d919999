//! A scenario as training data, with its mirrored and stretched variants.

use rand::RngExt;
use reactsim_geometry::Vec2;
use reactsim_scene::dynamics::PARKED_DISPLACEMENT;
use reactsim_scene::{Agent, AgentState, CURRENT, Frame, LightState};
use serde::{Deserialize, Serialize};

use super::map::LearningMap;
use super::window::Window;
use crate::perception::SceneView;
use crate::training::Stream;

/// Augmentation of scenes by draws from a stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneAugmentation {
    /// Largest shift of the prediction frame from the current one, frames.
    pub shift: usize,
    /// Probability that a scene is mirrored.
    pub mirror: f64,
    /// Largest relative change of scale, up or down.
    pub stretch: f64,
}

/// A logged scene: agents, their complete tracks, the map and the light states.
#[derive(Clone, Debug)]
pub struct LearningScene<M> {
    /// Agents; slot 0 is the AV.
    pub agents: Vec<Agent>,
    /// 91 frames per agent.
    pub tracks: Vec<Vec<Frame>>,
    /// Map data.
    pub map: M,
    /// State of every light in 91 frames.
    pub lights: Vec<Vec<Option<LightState>>>,
}

impl<M: LearningMap> LearningScene<M> {
    /// Builds the scene of a window of a scenario with the given map data.
    pub fn of(window: Window<'_>, map: M) -> Self {
        let Window { start, tracks, lights } = window;
        Self { agents: start.agents.clone(), tracks, map, lights }
    }

    /// Returns the scene augmented by draws from the stream, with the frame to predict from; without a stream as logged.
    pub fn augmented(self, by: &SceneAugmentation, stream: Option<&mut Stream>) -> (Self, usize) {
        let Some(stream) = stream else { return (self, CURRENT) };
        let scene = self.varied(by.mirror, by.stretch, stream);
        (scene, shifted(CURRENT, by.shift, stream))
    }

    /// Returns the scene mirrored with probability `mirror` and stretched by a factor that differs from 1
    /// by at most `stretch`, by two draws from the stream.
    pub fn varied(self, mirror: f64, stretch: f64, stream: &mut Stream) -> Self {
        let scene = if stream.random::<f64>() < mirror { self.mirrored() } else { self };
        scene.stretched(1.0 + stretch * (2.0 * stream.random::<f64>() - 1.0))
    }

    /// Returns the scene mirrored about the x axis.
    fn mirrored(mut self) -> Self {
        for state in self.tracks.iter_mut().flatten().flatten() {
            *state = AgentState { y: -state.y, heading: -state.heading, vy: -state.vy, ..*state };
        }
        self.map.mirror(|p| Vec2::new(p.x, -p.y));
        self
    }

    /// Returns the scene with all distances and speeds multiplied by `factor`; boxes keep their
    /// sizes.
    fn stretched(mut self, factor: f64) -> Self {
        for state in self.tracks.iter_mut().flatten().flatten() {
            let heading = state.heading;
            let (x, y, vx, vy) = (state.x * factor, state.y * factor, state.vx * factor, state.vy * factor);
            *state = AgentState { x, y, heading, vx, vy };
        }
        self.map.stretch(factor);
        self
    }
}

impl<M> LearningScene<M> {
    /// Separates the map from the rest of the scene.
    pub fn split_map(self) -> (LearningScene<()>, M) {
        let Self { agents, tracks, map, lights } = self;
        (LearningScene { agents, tracks, map: (), lights }, map)
    }

    /// Returns the states of the lights at a frame.
    pub fn lights_at(&self, frame: usize) -> Vec<Option<LightState>> {
        self.lights.iter().map(|l| l[frame]).collect()
    }

    /// Returns the scene at a frame as agents see it, if the first ones have these tracks. `blind` hides
    /// the next state of the AV.
    pub fn view<'a>(
        &'a self,
        tracks: &'a [Vec<Frame>],
        now: usize,
        blind: bool,
        lights: &'a [Option<LightState>],
    ) -> SceneView<'a> {
        let av_next = if blind { None } else { tracks[0].get(now + 1).copied().flatten() };
        // Training scenes keep no heights.
        SceneView {
            agents: &self.agents[..tracks.len()],
            tracks,
            now,
            first: 0,
            av_next,
            lights,
            start: None,
            heights: None,
        }
    }

    /// Returns whether an agent stays where it is first seen.
    pub fn is_parked(&self, slot: usize) -> bool {
        let mut present = self.tracks[slot].iter().flatten();
        let Some(first) = present.next() else { return true };
        present.all(|s| (s.position() - first.position()).norm() < PARKED_DISPLACEMENT)
    }
}

/// Returns a frame shifted by at most `shift` frames either way, by a draw from the stream.
pub fn shifted(frame: usize, shift: usize, stream: &mut Stream) -> usize {
    (frame + stream.random_range(0..=2 * shift)).saturating_sub(shift)
}
