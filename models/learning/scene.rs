//! A scenario as training data, with its mirrored and stretched variants.

use reactsim::geometry::Vec2;
use reactsim::scene::{Agent, AgentState, Frame, LightState, Scenario};

use super::map::LearningMap;

/// A logged scene: agents, their complete tracks, the map and the light states.
#[derive(Clone, Debug)]
pub(crate) struct LearningScene<M> {
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
    /// Builds the scene of a scenario with the given map data.
    pub(crate) fn of(scenario: &Scenario, map: M) -> Self {
        let start = &scenario.start;
        Self {
            agents: start.agents.clone(),
            tracks: (0..start.agents.len()).map(|a| scenario.logged(a)).collect(),
            map,
            lights: (0..start.lights.len()).map(|l| scenario.light_states(l)).collect(),
        }
    }

    /// Returns the scene mirrored about the x axis.
    pub(crate) fn mirrored(mut self) -> Self {
        for state in self.tracks.iter_mut().flatten().flatten() {
            *state = AgentState { y: -state.y, heading: -state.heading, vy: -state.vy, ..*state };
        }
        self.map.mirror(|p| Vec2::new(p.x, -p.y));
        self
    }

    /// Returns the scene with all distances and speeds multiplied by `factor`; boxes keep their
    /// sizes.
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
