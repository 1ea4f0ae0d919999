//! Scenes as inputs of the network.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_geometry::{Vec2, heading_of, math};
use reactsim_nn::SizeError;
use reactsim_nn::learning::Intentions;
use reactsim_nn::perception::{Class, KnownMap, Nearest, PieceKind, SceneView, Stop};
use reactsim_scene::{AgentState, Start};
use serde::{Deserialize, Serialize};

use super::network::{Line, SceneInput};
use crate::continued::{MEASURED_FRAMES, latest_motion};

/// Height of boxes, metres: scenarios have none, and the network wants one.
const HEIGHT: f64 = 1.6;
/// Number of states of lights that the network knows.
const LIGHT_STATES: usize = 8;

/// Limits of the network's input; stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sight {
    /// Number of agents, the AV first, then the nearest to it.
    pub agents: usize,
    /// Number of pieces of lines, nearest to the AV first.
    pub lines: usize,
    /// Number of lights, nearest to the AV first.
    pub lights: usize,
    /// Radius around the AV's position at the current frame within which the map is known, metres.
    pub radius: f64,
    /// Length of a piece of a line, metres.
    pub piece: f64,
}

impl Default for Sight {
    /// Returns sizes for two processor cores.
    fn default() -> Self {
        Self { agents: 32, lines: 64, lights: 8, radius: 100.0, piece: 20.0 }
    }
}

impl Sight {
    /// Checks the sizes.
    ///
    /// # Errors
    /// [`SizeError`], which names the field.
    pub(super) fn check(&self) -> Result<(), SizeError> {
        let refuse = |field, value, expected| Err(SizeError { field, value, expected });
        for (field, value) in [("agents", self.agents), ("lines", self.lines), ("lights", self.lights)] {
            if !(1..=4096).contains(&value) {
                return refuse(field, value as f64, "1 to 4096");
            }
        }
        for (field, value) in [("radius", self.radius), ("piece", self.piece)] {
            if !(1.0..1e4).contains(&value) {
                return refuse(field, value, "metres, from 1 to below 10000");
            }
        }
        Ok(())
    }

    /// Returns the known map of a scenario.
    pub(crate) fn map(&self, start: &Start) -> KnownMap {
        KnownMap::with_pieces(start, self.radius, self.piece)
    }
}

/// A scene as the network sees it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seen {
    pub(crate) input: SceneInput,
    /// Slots of the agents.
    pub(crate) slots: Vec<usize>,
    /// Their current states, with velocities.
    pub(crate) states: Vec<AgentState>,
    /// Their classes.
    pub(crate) classes: Vec<Class>,
}

impl Seen {
    /// Describes a scene; `None` if the AV is absent.
    pub(crate) fn of(view: &SceneView<'_>, map: &KnownMap, sight: &Sight) -> Option<Self> {
        let center = view.state(0)?.position();
        let mut seen = Self::default();
        let mut av = view.tracks[0][view.now.saturating_sub(MEASURED_FRAMES)..=view.now].to_vec();
        av.extend(view.av_next.map(Some));
        seen.input.av_motion = latest_motion(&av);
        for slot in view.nearest_agents(sight.agents) {
            let agent = &view.agents[slot];
            let (Some(state), Some(class)) = (view.state(slot), Class::of(agent.kind)) else { continue };
            let v = view.velocity(slot);
            let AgentState { x, y, heading, .. } = state;
            seen.input.agents.push([x, y, heading, v.x, v.y, agent.length, agent.width, HEIGHT]);
            seen.input.kinds.push(class.index() + 1);
            seen.slots.push(slot);
            seen.states.push(AgentState { vx: v.x, vy: v.y, ..state });
            seen.classes.push(class);
        }
        let mut nearest = Nearest::new(sight.lines);
        for (i, piece) in map.pieces.iter().enumerate() {
            nearest.offer((piece.points[piece.points.len() / 2] - center).norm(), i);
        }
        let code = |light: usize| {
            let state = view.lights.get(light).copied().flatten();
            state.map_or(0, |state| usize::from(state.code()).min(LIGHT_STATES - 1))
        };
        let light_of = |lane: usize| map.light_lanes.iter().position(|l| *l == lane);
        for i in nearest.found() {
            let piece = &map.pieces[i];
            let heading = |k: usize| {
                let next = (k + 1).min(piece.points.len() - 1);
                heading_of(piece.points[next] - piece.points[next - 1])
            };
            let point = |(k, p): (usize, &Vec2)| [p.x, p.y, heading(k)];
            seen.input.lines.push(Line {
                points: piece.points.iter().enumerate().map(point).collect(),
                light: piece.lane.and_then(light_of).map_or(0, code),
                kind: line_code(piece.kind),
            });
        }
        let mut nearest = Nearest::new(sight.lights);
        for (i, stop) in map.stops.iter().enumerate().filter(|(_, stop)| stop.light.is_some()) {
            nearest.offer((stop.at - center).norm(), i);
        }
        let lights = nearest.found().map(|i| &map.stops[i]);
        let light = |stop: &Stop| ([stop.at.x, stop.at.y], stop.light.map_or(0, code));
        seen.input.lights = lights.map(light).collect();
        Some(seen)
    }

    /// Returns the speeds of the agents, `[agents, 1]`, m/s.
    pub(super) fn speeds(&self, device: &Device) -> Tensor<2> {
        let speed = |agent: &[f64; 8]| math::hypot(agent[3], agent[4]) as f32;
        let values: Vec<f32> = self.input.agents.iter().map(speed).collect();
        let count = values.len();
        Tensor::from_data(TensorData::new(values, [count, 1]), device)
    }

    /// Returns the anchors of the agents by their classes, `[agents, anchors, 2]`, in their frames, metres.
    pub(super) fn anchors(&self, anchors: &Intentions, device: &Device) -> Tensor<3> {
        let points = |class: &Class| anchors.of(*class).iter().flat_map(|p| [p.x as f32, p.y as f32]);
        let values: Vec<f32> = self.classes.iter().flat_map(points).collect();
        Tensor::from_data(TensorData::new(values, [self.classes.len(), anchors.count(), 2]), device)
    }
}

/// Returns the type of a line in the public code, which are those of the Waymo Open Motion Dataset.
const fn line_code(kind: PieceKind) -> usize {
    match kind {
        PieceKind::Freeway => 1,
        PieceKind::Street => 2,
        PieceKind::BikeLane => 3,
        // The dataset does not tell connectors from lanes; the code is free.
        PieceKind::Junction => 4,
        PieceKind::EdgeBoundary => 15,
        PieceKind::EdgeMedian => 16,
        PieceKind::LightLine | PieceKind::SignLine | PieceKind::YieldLine => 17,
        PieceKind::Crosswalk => 18,
    }
}
