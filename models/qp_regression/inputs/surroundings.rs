//! Surroundings of one agent.

use reactsim_dynamics::Pose;
use reactsim_geometry::Vec2;
use reactsim_perception::{Class, Nearest, SceneView};
use reactsim_scene::{AgentState, DT};

use super::frame::LocalFrame;
use super::histories::histories;
use super::lines::LINE_FEATURES;
use super::scene_nodes::AGENT_FEATURES;
use super::{Outlook, PolylineFeatures, SceneContext};
use crate::network::{Attributes, Config};

/// Surroundings of one agent, in its frame.
#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    /// Class of the agent.
    pub class: Class,
    /// Pose of the agent in the scenario frame.
    pub pose: Pose,
    /// Slots of the agents, the predicted one first, then the AV, then the nearest.
    pub slots: Vec<usize>,
    /// Positions of these agents, metres.
    pub agent_places: Vec<[f32; 2]>,
    /// Their velocities in the frame of the predicted agent, m/s.
    pub velocities: Vec<Vec2>,
    /// Positions of the lines of the map nearest to the base point, nearest first, metres.
    pub line_places: Vec<[f32; 2]>,
    /// The agents and lines as the network sees them.
    pub content: Content,
    /// Index of the AV among these agents, and its forecast `[states, 4]`: x, y, velocity x, y.
    pub av: Option<(usize, Vec<f32>)>,
    /// Lane and conflict features, if the configuration has them.
    pub outlook: Option<Outlook>,
}

/// The agents and lines around an agent as the network sees them.
#[derive(Clone, Debug)]
pub(crate) enum Content {
    /// In the frame of the agent: histories of agents, and points of lines.
    AgentCentric { agents: PolylineFeatures, lines: PolylineFeatures },
    /// Rows of the nodes of the scene, and their relations to the agent.
    SceneCentric { agents: SeenNodes, lines: SeenNodes },
}

/// Nodes of the scene as an agent sees them.
#[derive(Clone, Debug, Default)]
pub(crate) struct SeenNodes {
    /// Row of each node.
    pub rows: Vec<u32>,
    /// Relation of each node to the agent, `[rows, features]`.
    pub relations: Vec<f32>,
}

impl SeenNodes {
    /// Appends a node, whose relation of this many features `relate` writes.
    fn push(&mut self, row: usize, features: usize, relate: impl FnOnce(&mut [f32])) {
        self.rows.push(row as u32);
        let first = self.relations.len();
        self.relations.resize(first + features, 0.0);
        relate(&mut self.relations[first..]);
    }
}

/// Distance of the base point, around which lines are chosen, as travel time at the present speed,
/// seconds.
const BASE_TIME: f64 = 2.0;
/// Smallest distance of the base point, metres.
const MIN_BASE_DISTANCE: f64 = 5.0;
/// Largest distance of the base point, metres.
const MAX_BASE_DISTANCE: f64 = 30.0;
/// Distance of the base point in the public code, metres.
const PUBLISHED_BASE_DISTANCE: f64 = 30.0;

impl Surroundings {
    /// Collects the surroundings of the agent `slot`; `None` if it is absent or of no class.
    pub(crate) fn of(scene: &SceneContext<'_>, slot: usize, config: &Config) -> Option<Self> {
        let view = scene.view;
        let class = Class::of(view.agents[slot].kind)?;
        let state = |slot: usize| view.tracks[slot].get(view.now).copied().flatten();
        let pose = Pose::from(state(slot)?);
        let frame = LocalFrame::of(pose);
        let mut nearest = Nearest::new(config.agents);
        for other in 0..view.agents.len() {
            let Some(there) = state(other).filter(|_| other == slot || !view.is_apart(slot, other)) else {
                continue;
            };
            let rank = match other {
                _ if other == slot => -2.0,
                0 => -1.0,
                _ => (there.position() - pose.position).norm(),
            };
            nearest.offer(rank, other);
        }
        let slots: Vec<usize> = nearest.found().collect();
        let velocities: Vec<Vec2> = slots.iter().map(|&s| frame.vector(velocity_now(view, s))).collect();
        let base = base_point(&frame, velocities.first().map_or(0.0, Vec2::norm), config);
        let av = scene.av.as_deref();
        let av = av.and_then(|states| Some((slots.iter().position(|&s| s == 0)?, states)));
        let lines = scene.ground.lines.nearest(base, config.lines);
        let place = |&slot: &usize| {
            let at = state(slot).map_or(Vec2::zeros(), |s| frame.point(s.position()));
            [at.x as f32, at.y as f32]
        };
        Some(Self {
            class,
            pose,
            agent_places: slots.iter().map(place).collect(),
            velocities,
            line_places: lines.iter().map(|&row| scene.ground.lines.place(row, &frame)).collect(),
            content: Content::of(scene, slot, &slots, &lines, &frame, config),
            outlook: Outlook::of(scene, slot, &frame),
            av: av.map(|(at, states)| (at, sampled_forecast(states, &frame, config))),
            slots,
        })
    }

    /// Returns the velocity of the predicted agent in its frame, m/s.
    pub(crate) fn velocity(&self) -> Vec2 {
        self.velocities.first().copied().unwrap_or_default()
    }
}

impl Content {
    /// Collects the agents of these slots and the lines of these rows around the agent `slot`.
    fn of(
        scene: &SceneContext<'_>,
        slot: usize,
        agents: &[usize],
        lines: &[usize],
        frame: &LocalFrame,
        config: &Config,
    ) -> Self {
        let (view, map) = (scene.view, &scene.ground.lines);
        let Some(nodes) = &scene.nodes else {
            let frames = agents.iter().map(|&other| (other, *frame));
            return Self::AgentCentric {
                agents: histories(view, frames, config.agents, Some(slot), config),
                lines: map.features(lines, frame, view.lights, config),
            };
        };
        let (mut seen_agents, mut seen_lines) = (SeenNodes::default(), SeenNodes::default());
        for &other in agents {
            if let Some(row) = nodes.row(other) {
                seen_agents.push(row, AGENT_FEATURES, |out| nodes.relate(row, frame, out));
            }
        }
        for &row in lines {
            seen_lines.push(row, LINE_FEATURES, |out| map.relate(row, frame, view.lights, out));
        }
        Self::SceneCentric { agents: seen_agents, lines: seen_lines }
    }
}

/// Returns the point around which lines matter to an agent with this speed, m/s.
pub(super) fn base_point(frame: &LocalFrame, speed: f64, config: &Config) -> Vec2 {
    let distance = match config.attributes {
        Attributes::Published => PUBLISHED_BASE_DISTANCE,
        Attributes::Own => (BASE_TIME * speed).clamp(MIN_BASE_DISTANCE, MAX_BASE_DISTANCE),
    };
    frame.point_out(Vec2::new(distance, 0.0))
}

/// Returns the present velocity of an agent, m/s; that of the AV from its next state, where that is
/// visible.
pub(super) fn velocity_now(view: &SceneView<'_>, slot: usize) -> Vec2 {
    let here = view.tracks[slot].get(view.now).copied().flatten();
    match (here, view.av_next) {
        (Some(here), Some(next)) if slot == 0 => (next.position() - here.position()) / DT,
        _ => view.velocity(slot),
    }
}

/// Returns the forecast at the predicted instants.
fn sampled_forecast(states: &[AgentState], frame: &LocalFrame, config: &Config) -> Vec<f32> {
    let each = states.iter().skip(config.step - 1).step_by(config.step).take(config.states());
    each.flat_map(|state| {
        let (p, v) = (frame.point(state.position()), frame.vector(Vec2::new(state.vx, state.vy)));
        [p.x, p.y, v.x, v.y].map(|value| value as f32)
    })
    .collect()
}
