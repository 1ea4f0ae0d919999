//! Surroundings of one agent.

use reactsim_geometry::Vec2;
use reactsim_nn::perception::{Class, Nearest, SceneView};
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{AgentState, DT};

use super::frame::LocalFrame;
use super::histories::histories;
use super::{Outlook, PolylineFeatures, SceneContext};
use crate::regression::network::{Attributes, Config};

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
    /// Histories of the agents.
    pub agents: PolylineFeatures,
    /// Points of the lines.
    pub lines: PolylineFeatures,
    /// Index of the AV among these agents, and its forecast `[states, 4]`: x, y, velocity x, y.
    pub av: Option<(usize, Vec<f32>)>,
    /// Lane and conflict features, if the configuration has them.
    pub outlook: Option<Outlook>,
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
            agents: histories(view, &slots, &frame, config),
            lines: scene.ground.lines.features(&lines, &frame, view.lights, config),
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

/// Returns the point around which lines matter to an agent with this speed, m/s.
fn base_point(frame: &LocalFrame, speed: f64, config: &Config) -> Vec2 {
    let distance = match config.attributes {
        Attributes::Published => PUBLISHED_BASE_DISTANCE,
        Attributes::Own => (BASE_TIME * speed).clamp(MIN_BASE_DISTANCE, MAX_BASE_DISTANCE),
    };
    frame.point_out(Vec2::new(distance, 0.0))
}

/// Returns the present velocity of an agent, m/s; that of the AV from its next state, where that is
/// visible.
fn velocity_now(view: &SceneView<'_>, slot: usize) -> Vec2 {
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
