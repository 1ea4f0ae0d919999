//! The objects around ego in a rollout.

use std::borrow::Cow;
use std::collections::BTreeSet;

use reactsim_geometry::{Vec2, heading_of};
use reactsim_rollout::Observation;
use reactsim_scene::{Agent, AgentKind, AgentState, DT, Frame, Scenario, Start};

use crate::metrics::{Label, Reach};
use crate::{ObjectId, ObjectKind, TrackedObject};

use super::AV;

/// Returns the objects at each frame from the current one on: the agents that are present, without the AV,
/// and the obstacles, which stay where they are at the current frame unless the context of the scenario
/// changes. `tracks`: the frames of each agent.
///
/// Agents without a box, and objects on another level than the AV, are left out. An unknown velocity is the
/// displacement since the previous frame divided by the time step, else that to the next frame, else 0;
/// [`Label::SpeedsDisplacement`] is then inserted.
pub fn rollout_objects(
    scenario: &Scenario,
    tracks: &[Vec<Frame>],
    labels: &mut BTreeSet<Label>,
) -> Vec<Vec<TrackedObject>> {
    let mut start = Cow::Borrowed(&scenario.start);
    let mut ids = ObjectIds::new(&start);
    let (current, samples) = (start.current(), scenario.length().future + 1);
    let heights = heights_per_sample(&start, tracks, samples);
    let at = |k: usize| {
        if scenario.context_changes {
            start.to_mut().set_context(scenario, current + k);
            ids.obstacles = obstacle_ids(&start);
        }
        let frame = ObjectFrame {
            start: &start,
            ids: &ids,
            tracks,
            frame: current + k,
            heights: heights.get(k).map_or(&[], Vec::as_slice),
        };
        let (objects, is_estimated) = frame.objects(Differences::BackwardOrForward, None);
        if is_estimated {
            labels.insert(Label::SpeedsDisplacement);
        }
        objects
    };
    (0..samples).map(at).collect()
}

/// Ids of the objects of a scenario. No agent has the id of an obstacle.
#[derive(Clone, Debug)]
pub struct ObjectIds {
    agents: Vec<ObjectId>,
    obstacles: Vec<ObjectId>,
}

impl ObjectIds {
    /// Creates the ids of the agents and obstacles of a scenario.
    pub fn new(start: &Start) -> Self {
        Self {
            agents: start.agents.iter().map(|agent| ObjectId::from(agent.id.as_str())).collect(),
            obstacles: obstacle_ids(start),
        }
    }

    /// Returns the id of an agent.
    ///
    /// # Panics
    /// If the scenario has no agent in this slot.
    pub fn agent(&self, slot: usize) -> &ObjectId {
        &self.agents[slot]
    }

    /// Returns the slot of the agent with this id.
    pub fn slot(&self, agent: &ObjectId) -> Option<usize> {
        self.agents.iter().position(|id| id == agent)
    }

    /// Returns the obstacles of the scenario, which stand, as objects.
    pub fn obstacles(&self, start: &Start) -> impl Iterator<Item = TrackedObject> {
        start.obstacles.iter().zip(&self.obstacles).map(|(obstacle, id)| TrackedObject {
            id: id.clone(),
            kind: ObjectKind::GenericObject,
            center: obstacle.center,
            heading: heading_of(obstacle.axis),
            length: 2.0 * obstacle.half_length,
            width: 2.0 * obstacle.half_width,
            velocity: Vec2::zeros(),
        })
    }

    /// Returns the objects within reach of ego at present, by the rules of [`rollout_objects`]. An unknown
    /// velocity is the displacement since the frame before.
    pub fn objects_near(&self, seen: &Observation<'_>, reach: &Reach) -> Vec<TrackedObject> {
        let (start, tracks, frame) = (seen.start(), seen.tracks(), seen.frame());
        ObjectFrame { start, ids: self, tracks, frame, heights: &seen.heights() }
            .objects(Differences::Backward, Some(reach))
            .0
    }
}

/// Positions from which unknown velocities are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Differences {
    /// The frame before, else the frame after.
    BackwardOrForward,
    /// The frame before only: what is known at the frame.
    Backward,
}

fn obstacle_ids(start: &Start) -> Vec<ObjectId> {
    let number = |i: usize| start.obstacle_numbers.get(i).copied().unwrap_or(i);
    (0..start.obstacles.len()).map(|i| ObjectId::from(format!("obstacle:{}", number(i)))).collect()
}

/// One frame of a rollout.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObjectFrame<'a> {
    pub(crate) start: &'a Start,
    pub(crate) ids: &'a ObjectIds,
    /// Frames per agent, from frame 0 on.
    pub(crate) tracks: &'a [Vec<Frame>],
    /// The frame.
    pub(crate) frame: usize,
    /// Height of each agent at the frame, metres, NaN if unknown; empty in scenarios of one level.
    pub(crate) heights: &'a [f64],
}

impl ObjectFrame<'_> {
    /// Returns the objects by the rules of [`rollout_objects`], all or those within reach of ego, and whether
    /// a velocity is estimated.
    pub(crate) fn objects(
        &self,
        differences: Differences,
        reach: Option<&Reach>,
    ) -> (Vec<TrackedObject>, bool) {
        let is_near = |center: Vec2, length: f64, width: f64, velocity: Vec2| {
            reach.is_none_or(|reach| reach.includes(center, length, width, velocity))
        };
        let mut is_estimated = false;
        let mut objects = Vec::new();
        let agents = self.start.agents.iter().zip(&self.ids.agents).zip(self.tracks);
        for (i, ((agent, id), track)) in agents.enumerate().skip(AV + 1) {
            let Some(state) = state_at(track, self.frame).filter(|_| agent.has_extent()) else { continue };
            if self.is_apart_from_av(self.height(i), state.position()) {
                continue;
            }
            let velocity = state.velocity().unwrap_or_else(|| {
                is_estimated = true;
                displacement_velocity(track, self.frame, differences)
            });
            if !is_near(state.position(), agent.length, agent.width, velocity) {
                continue;
            }
            objects.push(agent_object(id, agent, &state, velocity));
        }
        let is_there = |(i, o): &(usize, TrackedObject)| {
            is_near(o.center, o.length, o.width, o.velocity)
                && o.is_finite()
                && !self.is_apart_from_av(self.start.obstacle_height(*i), o.center)
        };
        objects.extend(self.ids.obstacles(self.start).enumerate().filter(is_there).map(|(_, object)| object));
        (objects, is_estimated)
    }

    /// Returns the height of an agent; NaN if unknown.
    fn height(&self, agent: usize) -> f64 {
        self.heights.get(agent).copied().unwrap_or(f64::NAN)
    }

    /// Returns whether an object is on another level than the AV.
    fn is_apart_from_av(&self, height: f64, center: Vec2) -> bool {
        let Some(av) = self.tracks.get(AV).and_then(|track| state_at(track, self.frame)) else {
            return false;
        };
        self.start.road().is_apart((center, height), (av.position(), self.height(AV)))
    }
}

/// Returns an agent in a state as an object with this velocity, m/s.
pub fn agent_object(id: &ObjectId, agent: &Agent, state: &AgentState, velocity: Vec2) -> TrackedObject {
    TrackedObject {
        id: id.clone(),
        kind: kind_of(agent.kind),
        center: state.position(),
        heading: state.heading,
        length: agent.length,
        width: agent.width,
        velocity,
    }
}

/// Returns the class of the agents of a kind.
fn kind_of(kind: AgentKind) -> ObjectKind {
    match kind {
        AgentKind::Vehicle => ObjectKind::Vehicle,
        AgentKind::Pedestrian => ObjectKind::Pedestrian,
        AgentKind::Cyclist => ObjectKind::Bicycle,
        AgentKind::Other => ObjectKind::GenericObject,
    }
}

/// Returns the state at a frame, if it is present and finite.
fn state_at(track: &[Frame], frame: usize) -> Option<AgentState> {
    track.get(frame).copied().flatten().filter(AgentState::is_finite)
}

/// Returns the backward difference of the positions, else the forward difference if it may be used, else 0,
/// m/s.
fn displacement_velocity(track: &[Frame], frame: usize, differences: Differences) -> Vec2 {
    let step = |from: usize, to: usize| {
        Some((state_at(track, to)?.position() - state_at(track, from)?.position()) / DT)
    };
    let forward = || match differences {
        Differences::BackwardOrForward => step(frame, frame + 1),
        Differences::Backward => None,
    };
    frame.checked_sub(1).and_then(|before| step(before, frame)).or_else(forward).unwrap_or_default()
}

/// Returns the heights of the agents per sample, metres, NaN if unknown; empty in scenarios of one level.
fn heights_per_sample(start: &Start, tracks: &[Vec<Frame>], samples: usize) -> Vec<Vec<f64>> {
    if !start.has_levels() {
        return Vec::new();
    }
    let frames = start.current()..start.current() + samples;
    let after = |track: &Vec<Frame>| track.get(frames.clone()).map(<[Frame]>::to_vec).unwrap_or_default();
    let along = |(i, track)| start.heights_along(i, &after(track));
    let per_agent: Vec<Vec<f64>> = tracks.iter().enumerate().map(along).collect();
    let at = |k: usize| per_agent.iter().map(|h| h.get(k).copied().unwrap_or(f64::NAN)).collect();
    (0..samples).map(at).collect()
}
