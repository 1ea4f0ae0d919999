//! A scenario as it is learnt from, and its variants: mirrored, stretched.

use reactsim::geometry::Vec2;
use reactsim::scene::{Agent, AgentState, Frame, LightState, Scenario};

/// What a network is shown of a map.
pub(crate) trait LearningMap {
    /// Moves every point by this map, which turns left into right.
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2);

    /// Multiplies all distances and speeds.
    fn stretch(&mut self, factor: f64);
}

/// A logged scene: agents, their whole tracks, the map, what lights showed.
#[derive(Clone, Debug)]
pub(crate) struct LearningScene<M> {
    /// Slot 0 is the AV.
    pub agents: Vec<Agent>,
    /// Per agent 91 frames.
    pub tracks: Vec<Vec<Frame>>,
    /// The map.
    pub map: M,
    /// Per light what it showed in 91 frames.
    pub lights: Vec<Vec<Option<LightState>>>,
}

impl<M: LearningMap> LearningScene<M> {
    /// The scene of a scenario, with what is shown of its map.
    pub(crate) fn of(scenario: &Scenario, map: M) -> Self {
        let start = &scenario.start;
        Self {
            agents: start.agents.clone(),
            tracks: (0..start.agents.len()).map(|a| scenario.logged(a)).collect(),
            map,
            lights: (0..start.lights.len()).map(|l| scenario.light_states(l)).collect(),
        }
    }

    /// The scene seen in a mirror along the x axis.
    pub(crate) fn mirrored(mut self) -> Self {
        for state in self.tracks.iter_mut().flatten().flatten() {
            *state = AgentState { y: -state.y, heading: -state.heading, vy: -state.vy, ..*state };
        }
        self.map.mirror(|p| Vec2::new(p.x, -p.y));
        self
    }

    /// The scene with all distances and speeds multiplied; boxes keep their sizes.
    pub(crate) fn stretched(mut self, factor: f64) -> Self {
        for state in self.tracks.iter_mut().flatten().flatten() {
            let heading = state.heading;
            let (x, y, vx, vy) = (state.x * factor, state.y * factor, state.vx * factor, state.vy * factor);
            *state = AgentState { x, y, heading, vx, vy };
        }
        self.map.stretch(factor);
        self
    }
}
