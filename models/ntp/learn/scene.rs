//! A scenario as it is learnt from, and its variants: mirrored, stretched.

use reactsim::geometry::Vec2;
use reactsim::scene::{Agent, AgentState, Frame, LightState, Scenario};

use super::super::reactive::known_map::KnownMap;
use super::super::tokens::PieceKind;

/// A logged scene: agents, their whole tracks, the map, what lights showed.
#[derive(Clone, Debug)]
pub(crate) struct LearningScene {
    /// Slot 0 is the AV.
    pub agents: Vec<Agent>,
    /// Per agent 91 frames.
    pub tracks: Vec<Vec<Frame>>,
    /// The map.
    pub map: KnownMap,
    /// Per light what it showed in 91 frames.
    pub lights: Vec<Vec<Option<LightState>>>,
}

impl LearningScene {
    /// The scene of a scenario, with the map within `radius` metres of the AV's current position.
    pub(crate) fn of(scenario: &Scenario, radius: f64) -> Self {
        let start = &scenario.start;
        Self {
            agents: start.agents.clone(),
            tracks: (0..start.agents.len()).map(|a| scenario.logged(a)).collect(),
            map: KnownMap::of(start, radius),
            lights: (0..start.lights.len()).map(|l| scenario.light_states(l)).collect(),
        }
    }

    /// The scene seen in a mirror along the x axis.
    pub(crate) fn mirrored(mut self) -> Self {
        let flip = |p: Vec2| Vec2::new(p.x, -p.y);
        for state in self.tracks.iter_mut().flatten().flatten() {
            *state = AgentState { y: -state.y, heading: -state.heading, vy: -state.vy, ..*state };
        }
        for piece in &mut self.map.pieces {
            piece.points = piece.points.map(flip);
            // Edges have the road on their left.
            if matches!(piece.kind, PieceKind::EdgeBoundary | PieceKind::EdgeMedian) {
                piece.points.reverse();
            }
        }
        for stop in &mut self.map.stops {
            (stop.at, stop.ahead) = (flip(stop.at), flip(stop.ahead));
        }
        self
    }

    /// The scene with all distances and speeds multiplied; boxes keep their sizes.
    pub(crate) fn stretched(mut self, factor: f64) -> Self {
        for state in self.tracks.iter_mut().flatten().flatten() {
            let heading = state.heading;
            let (x, y, vx, vy) = (state.x * factor, state.y * factor, state.vx * factor, state.vy * factor);
            *state = AgentState { x, y, heading, vx, vy };
        }
        for piece in &mut self.map.pieces {
            piece.points = piece.points.map(|p| p * factor);
            piece.length *= factor;
            piece.speed_limit = piece.speed_limit.map(|v| v * factor);
        }
        for stop in &mut self.map.stops {
            stop.at *= factor;
        }
        self
    }
}
