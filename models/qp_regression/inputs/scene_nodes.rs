//! Agents of a scene as nodes of an encoder that encodes the scene once.

use reactsim_geometry::Vec2;
use reactsim_nn::Links;
use reactsim_perception::{Nearest, SceneView};

use super::frame::{LocalFrame, POSE_FEATURES};
use super::histories::histories;
use super::lines::LINE_FEATURES;
use super::surroundings::{base_point, velocity_now};
use super::{MapFeatures, PolylineFeatures};
use crate::network::Config;

/// Number of features of the relation of an agent to another one: its pose, its velocity, and whether it is
/// the AV.
pub(crate) const AGENT_FEATURES: usize = POSE_FEATURES + 3;
/// Scale of velocities, s/m, for numbers near 1.
const VELOCITY_SCALE: f64 = 0.1;

/// The present agents of a scene, each in a frame of its own.
#[derive(Clone, Debug)]
pub(crate) struct SceneNodes {
    /// Their slots, ascending.
    pub slots: Vec<usize>,
    /// Their histories.
    pub histories: PolylineFeatures,
    /// Links of each agent to the lines near its base point.
    pub to_lines: Links,
    /// Links of each agent to others: the AV, then the nearest.
    pub to_agents: Links,
    frames: Vec<LocalFrame>,
    /// Velocities in the scenario frame, m/s.
    velocities: Vec<Vec2>,
}

impl SceneNodes {
    /// Collects the agents of a view.
    pub(super) fn of(view: &SceneView<'_>, ground: &MapFeatures, config: &Config) -> Self {
        let present = |slot: usize| {
            let state = view.tracks[slot].get(view.now).copied().flatten()?;
            Some((slot, LocalFrame::of(state.into())))
        };
        let (slots, frames): (Vec<usize>, Vec<LocalFrame>) =
            (0..view.agents.len()).filter_map(present).unzip();
        let velocities: Vec<Vec2> = slots.iter().map(|&slot| velocity_now(view, slot)).collect();
        let agents = slots.iter().copied().zip(frames.iter().copied());
        let mut nodes = Self {
            histories: histories(view, agents, slots.len(), None, config),
            to_lines: Links::default(),
            to_agents: Links::default(),
            slots,
            frames,
            velocities,
        };
        nodes.link_lines(view, ground, config);
        nodes.link_agents(view, config);
        nodes
    }

    fn link_lines(&mut self, view: &SceneView<'_>, ground: &MapFeatures, config: &Config) {
        for (frame, velocity) in self.frames.iter().zip(&self.velocities) {
            let base = base_point(frame, velocity.norm(), config);
            let near = ground.lines.nearest(base, config.line_neighbours);
            self.to_lines.push(config.line_neighbours, LINE_FEATURES, &near, |row, out| {
                ground.lines.relate(row, frame, view.lights, out);
            });
        }
    }

    fn link_agents(&mut self, view: &SceneView<'_>, config: &Config) {
        let mut links = Links::default();
        let mut nearest = Nearest::new(config.neighbours);
        for (i, frame) in self.frames.iter().enumerate() {
            nearest.clear();
            for (j, other) in self.frames.iter().enumerate() {
                if i != j && !view.is_apart(self.slots[i], self.slots[j]) {
                    // The AV ranks first at any distance: agents must always see it.
                    let rank = if self.slots[j] == 0 { -1.0 } else { frame.distance(other) };
                    nearest.offer(rank, j);
                }
            }
            let near: Vec<usize> = nearest.found().collect();
            links.push(config.neighbours, AGENT_FEATURES, &near, |j, out| self.relate(j, frame, out));
        }
        self.to_agents = links;
    }

    /// Returns the row of the agent with this slot.
    pub(super) fn row(&self, slot: usize) -> Option<usize> {
        self.slots.binary_search(&slot).ok()
    }

    /// Writes the relation of the agent of a row to another agent with this frame, [`AGENT_FEATURES`]
    /// numbers.
    pub(super) fn relate(&self, row: usize, frame: &LocalFrame, out: &mut [f32]) {
        let velocity = frame.vector(self.velocities[row]) * VELOCITY_SCALE;
        let is_av = f64::from(u8::from(self.slots[row] == 0));
        let features =
            frame.pose_features(&self.frames[row]).into_iter().chain([velocity.x, velocity.y, is_av]);
        for (slot, value) in out.iter_mut().zip(features) {
            *slot = value as f32;
        }
    }
}
