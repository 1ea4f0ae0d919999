//! The objects around ego in a rollout.

use std::collections::BTreeSet;

use reactsim_geometry::Vec2;
use reactsim_scene::{Agent, AgentKind, AgentState, CURRENT, DT, FRAMES, Frame, Scenario, levels};

use crate::metrics::Label;
use crate::{ObjectId, ObjectKind, TrackedObject};

use super::{AV, SAMPLES};

/// Returns the objects at each frame from 10 to 90: the agents that are present, without the AV, and the
/// obstacles, which stay where they are at the current frame. `tracks`: 91 frames per agent.
///
/// Agents without a box, and objects on another level than the AV, are left out. An unknown velocity is the
/// displacement since the previous frame divided by the time step, else that to the next frame, else 0;
/// [`Label::SpeedsDisplacement`] is then inserted.
pub fn rollout_objects(
    scenario: &Scenario,
    tracks: &[Vec<Frame>],
    labels: &mut BTreeSet<Label>,
) -> Vec<Vec<TrackedObject>> {
    let heights = Heights::new(scenario, tracks);
    let mut samples = vec![Vec::new(); SAMPLES];
    for (i, (agent, track)) in scenario.start.agents.iter().zip(tracks).enumerate().skip(AV + 1) {
        let id = ObjectId::from(agent.id.as_str());
        for (k, sample) in samples.iter_mut().enumerate() {
            let Some(state) = state_at(track, CURRENT + k).filter(|_| agent.has_extent()) else { continue };
            if heights.is_apart_from_av(tracks, k, heights.of_agent(i, k), state.position()) {
                continue;
            }
            let velocity = state.velocity().unwrap_or_else(|| {
                labels.insert(Label::SpeedsDisplacement);
                displacement_velocity(track, CURRENT + k)
            });
            sample.push(object(&id, agent, &state, velocity));
        }
    }
    add_obstacles(scenario, tracks, &heights, &mut samples);
    samples
}

fn object(id: &ObjectId, agent: &Agent, state: &AgentState, velocity: Vec2) -> TrackedObject {
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

fn kind_of(kind: AgentKind) -> ObjectKind {
    match kind {
        AgentKind::Vehicle => ObjectKind::Vehicle,
        AgentKind::Pedestrian => ObjectKind::Pedestrian,
        AgentKind::Cyclist => ObjectKind::Bicycle,
        AgentKind::Other => ObjectKind::GenericObject,
    }
}

/// Adds the obstacles to every sample. No agent has one of their ids.
fn add_obstacles(
    scenario: &Scenario,
    tracks: &[Vec<Frame>],
    heights: &Heights,
    samples: &mut [Vec<TrackedObject>],
) {
    for (i, obstacle) in scenario.start.obstacles.iter().enumerate() {
        let standing = TrackedObject {
            id: ObjectId::from(format!("obstacle:{i}")),
            kind: ObjectKind::GenericObject,
            center: obstacle.center,
            heading: reactsim_geometry::heading_of(obstacle.axis),
            length: 2.0 * obstacle.half_length,
            width: 2.0 * obstacle.half_width,
            velocity: Vec2::zeros(),
        };
        let height = scenario.start.obstacle_height(i);
        for (k, sample) in samples.iter_mut().enumerate() {
            if standing.is_finite() && !heights.is_apart_from_av(tracks, k, height, standing.center) {
                sample.push(standing.clone());
            }
        }
    }
}

/// Returns the state at a frame, if it is present and finite.
fn state_at(track: &[Frame], frame: usize) -> Option<AgentState> {
    track.get(frame).copied().flatten().filter(AgentState::is_finite)
}

/// Returns the backward difference of the positions, else the forward difference, else 0, m/s.
fn displacement_velocity(track: &[Frame], frame: usize) -> Vec2 {
    let step = |from: usize, to: usize| {
        Some((state_at(track, to)?.position() - state_at(track, from)?.position()) / DT)
    };
    frame
        .checked_sub(1)
        .and_then(|before| step(before, frame))
        .or_else(|| step(frame, frame + 1))
        .unwrap_or_default()
}

/// Heights of the agents per sample, metres; empty in scenarios of one level.
struct Heights(Vec<Vec<f64>>);

impl Heights {
    fn new(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Self {
        if !scenario.start.has_levels() {
            return Self(Vec::new());
        }
        let after =
            |track: &'_ Vec<Frame>| track.get(CURRENT..FRAMES).map(<[Frame]>::to_vec).unwrap_or_default();
        let along = |(i, track)| scenario.start.heights_along(i, &after(track));
        Self(tracks.iter().enumerate().map(along).collect())
    }

    /// Returns the height of an agent at a sample; NaN if unknown.
    fn of_agent(&self, agent: usize, sample: usize) -> f64 {
        self.0.get(agent).and_then(|heights| heights.get(sample)).copied().unwrap_or(f64::NAN)
    }

    /// Returns whether an object is on another level than the AV at a sample.
    fn is_apart_from_av(&self, tracks: &[Vec<Frame>], sample: usize, height: f64, center: Vec2) -> bool {
        let Some(av) = tracks.get(AV).and_then(|track| state_at(track, CURRENT + sample)) else {
            return false;
        };
        levels::apart(height, self.of_agent(AV, sample), (center - av.position()).norm())
    }
}
