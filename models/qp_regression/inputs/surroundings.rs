//! What is around one agent.

use reactsim::dynamics::Pose;
use reactsim::geometry::{Vec2, direction, into_frame};
use reactsim::scene::{DT, HISTORY};

use super::histories::{Told, agent_numbers, velocity_at};
use super::lines::point_numbers;
use super::{Outlook, Scene};
use crate::models::ntp::reactive::links::Nearest;
use crate::models::ntp::reactive::step::View;
use crate::models::ntp::tokens::Class;
use crate::models::qp_regression::network::{Attributes, Config};

/// The frame of an agent: it is at the origin and looks along x.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame2 {
    origin: Vec2,
    ahead: Vec2,
}

impl Frame2 {
    pub(crate) fn of(pose: Pose) -> Self {
        Self { origin: pose.position, ahead: direction(pose.heading) }
    }

    /// A point of the scene in this frame.
    pub(crate) fn point(&self, p: Vec2) -> Vec2 {
        into_frame(self.ahead, p - self.origin)
    }

    /// A vector of the scene in this frame.
    pub(crate) fn vector(&self, v: Vec2) -> Vec2 {
        into_frame(self.ahead, v)
    }

    /// The unit vector of a heading in this frame.
    pub(crate) fn toward(&self, heading: f64) -> Vec2 {
        into_frame(self.ahead, direction(heading))
    }

    /// A vector of this frame in the scene.
    pub(crate) fn vector_out(&self, v: Vec2) -> Vec2 {
        self.ahead * v.x + Vec2::new(-self.ahead.y, self.ahead.x) * v.y
    }

    /// A point of this frame in the scene.
    pub(crate) fn point_out(&self, p: Vec2) -> Vec2 {
        self.origin + self.vector_out(p)
    }
}

/// Polylines as numbers: `count` points of a fixed number of rows; rows that are not there are zeros at the end.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows {
    /// `[count, rows, numbers]`.
    pub points: Vec<f32>,
    /// `[count, rows]`: 1 where there is a point.
    pub there: Vec<f32>,
    /// Where the rows that are there are, metres.
    pub places: Vec<[f32; 2]>,
}

/// What is around one agent, in its frame.
#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    /// Its class.
    pub class: Class,
    /// Its pose.
    pub pose: Pose,
    /// Slots of the agents, the predicted one first, then the AV, then the nearest.
    pub slots: Vec<usize>,
    /// Their histories.
    pub agents: Rows,
    /// Their velocities, m/s.
    pub velocities: Vec<Vec2>,
    /// The lines of the map nearest to the base point, nearest first.
    pub lines: Rows,
    /// Which of the agents is the AV, and its forecast `[states, 4]`: x, y, velocity x, y.
    pub av: Option<(usize, Vec<f32>)>,
    /// Where its lane leads and what is in its way, where that is shown.
    pub outlook: Option<Outlook>,
}

/// The base point lies where an agent will be in so many seconds, between these distances, metres.
const BASE_AHEAD: (f64, f64, f64) = (2.0, 5.0, 30.0);
/// In the public code it lies so far ahead, metres.
const PUBLISHED_BASE: f64 = 30.0;

impl Surroundings {
    /// What is around the agent `slot`; `None` where it is absent or of no class.
    pub(crate) fn of(scene: &Scene<'_>, slot: usize, config: &Config) -> Option<Self> {
        let view = scene.view;
        let class = Class::of(view.agents[slot].kind)?;
        let state = |slot: usize| view.tracks[slot].get(view.now).copied().flatten();
        let pose = Pose::from(state(slot)?);
        let frame = Frame2::of(pose);
        let mut nearest = Nearest::new(config.agents);
        for other in 0..view.agents.len() {
            let Some(there) = state(other) else { continue };
            let rank = match other {
                _ if other == slot => -2.0,
                0 => -1.0,
                _ => (there.position() - pose.position).norm(),
            };
            nearest.offer(rank, other);
        }
        let slots: Vec<usize> = nearest.found().collect();
        let velocities: Vec<Vec2> = slots.iter().map(|&s| frame.vector(velocity_now(view, s))).collect();
        let base = match config.attributes {
            Attributes::Published => PUBLISHED_BASE,
            Attributes::Own => {
                (BASE_AHEAD.0 * velocities.first().map_or(0.0, Vec2::norm)).clamp(BASE_AHEAD.1, BASE_AHEAD.2)
            }
        };
        let base = frame.point_out(Vec2::new(base, 0.0));
        let av = scene.av.as_deref();
        let av = av.and_then(|states| Some((slots.iter().position(|&s| s == 0)?, states)));
        Some(Self {
            class,
            pose,
            agents: histories(view, &slots, &frame, slot, config),
            velocities,
            lines: scene.ground.lines.rows(base, &frame, view.lights, config),
            outlook: Outlook::of(scene, slot, &frame),
            av: av.map(|(at, states)| (at, told(states, &frame, config))),
            slots,
        })
    }

    /// The velocity of the predicted agent in its frame, m/s.
    pub(crate) fn velocity(&self) -> Vec2 {
        self.velocities.first().copied().unwrap_or_default()
    }
}

/// How an agent moves now, m/s: the AV as the state to come shows it, where that is shown.
fn velocity_now(view: &View<'_>, slot: usize) -> Vec2 {
    let here = view.tracks[slot].get(view.now).copied().flatten();
    match (here, view.av_next) {
        (Some(here), Some(next)) if slot == 0 => (next.position() - here.position()) / DT,
        _ => velocity_at(&view.tracks[slot], view.now),
    }
}

fn histories(view: &View<'_>, slots: &[usize], frame: &Frame2, target: usize, config: &Config) -> Rows {
    let numbers = agent_numbers(config.attributes);
    let mut rows = Rows {
        points: vec![0.0; HISTORY * config.agents * numbers],
        there: vec![0.0; HISTORY * config.agents],
        places: Vec::with_capacity(slots.len()),
    };
    for (row, &slot) in slots.iter().enumerate() {
        let told = Told {
            agent: &view.agents[slot],
            track: &view.tracks[slot],
            now: view.now,
            is_target: slot == target,
            is_av: slot == 0,
        };
        for k in 0..HISTORY {
            let at = k * config.agents + row;
            let out = &mut rows.points[at * numbers..(at + 1) * numbers];
            if told.write(k, frame, config.attributes, out) {
                rows.there[at] = 1.0;
            }
        }
        let place = view.tracks[slot][view.now].map(|s| frame.point(s.position())).unwrap_or_default();
        rows.places.push([place.x as f32, place.y as f32]);
    }
    debug_assert_eq!(rows.points.len(), HISTORY * config.agents * numbers);
    debug_assert!(rows.places.len() <= config.agents && point_numbers(config.attributes) > 0);
    rows
}

/// The forecast at the instants that are predicted.
fn told(states: &[(Vec2, Vec2)], frame: &Frame2, config: &Config) -> Vec<f32> {
    let each = states.iter().skip(config.step - 1).step_by(config.step).take(config.states());
    each.flat_map(|(p, v)| {
        let (p, v) = (frame.point(*p), frame.vector(*v));
        [p.x, p.y, v.x, v.y].map(|value| value as f32)
    })
    .collect()
}
