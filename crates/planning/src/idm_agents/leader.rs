//! The leader of an agent: the nearest of what is on its path.

use reactsim_geometry::math;

use crate::ground::Ground;
use crate::planner::{Light, LightState};
use crate::{ObjectId, TrackedObject};

use super::{AgentRoads, IdmAgent, SeenEgo};

/// What an agent follows.
#[derive(Clone, Debug, PartialEq)]
pub enum Leader {
    /// The end of its path.
    PathEnd,
    /// Ego.
    Ego,
    /// Another agent.
    Agent(ObjectId),
    /// An object that is not an agent.
    Object(ObjectId),
    /// The stop line of a red signal, by its name.
    StopLine(String),
}

/// How an agent followed its leader.
#[derive(Clone, Debug, PartialEq)]
pub struct Lead {
    /// The leader.
    pub leader: Leader,
    /// Distance of the footprints, or length of the path left, metres.
    pub distance: f64,
    /// Speed of the leader along the heading of the agent, m/s; 0 for all but ego and agents.
    pub speed: f64,
    /// Part of the distance that is not free, metres: half the length of the agent at the end of its path.
    pub rear: f64,
}

/// What an agent sees.
pub(super) struct Seen<'a> {
    pub(super) roads: &'a AgentRoads,
    pub(super) ego: Option<&'a (SeenEgo, Ground)>,
    pub(super) objects: &'a [(&'a TrackedObject, Ground)],
    pub(super) lights: &'a [Light],
}

impl Seen<'_> {
    /// Returns how an agent follows: the nearest of what touches the strip of its path ahead, measured from
    /// its own footprint.
    pub(super) fn lead_of(&self, agent: usize, agents: &[IdmAgent]) -> Lead {
        let own = &agents[agent];
        let strip = own.strip();
        let heading = own.pose().heading;
        let along = |speed: f64, other: f64| speed * math::cos(other - heading);
        // With distance, metres, then y and x of the middle of the bounds: the first of equally distant ones
        // is that which the devkit finds (GEOS 3.11, `STRtree`, with at most ten candidates).
        let mut nearest: Option<([f64; 3], Lead)> = None;
        let mut consider = |ground: &Ground, speed: f64, leader: &dyn Fn() -> Leader| {
            if !strip.touches(ground) {
                return;
            }
            let middle = ground.middle();
            let distance = own.ground.distance(ground);
            let order = [distance, middle.y, middle.x];
            if nearest.as_ref().is_none_or(|nearest| order < nearest.0) {
                nearest = Some((order, Lead { leader: leader(), distance, speed, rear: 0.0 }));
            }
        };
        if let Some((ego, ground)) = self.ego {
            consider(ground, along(ego.speed, ego.heading), &|| Leader::Ego);
        }
        for (object, ground) in self.objects {
            consider(ground, 0.0, &|| Leader::Object(object.id.clone()));
        }
        for (_, other) in agents.iter().enumerate().filter(|&(i, _)| i != agent) {
            let speed = along(other.speed(), other.pose().heading);
            consider(&other.ground, speed, &|| Leader::Agent(other.id().clone()));
        }
        let is_red = |lane: &usize| self.lights.contains(&Light { lane: *lane, state: LightState::Red });
        let red: Vec<usize> = own.route().iter().copied().filter(is_red).collect();
        for line in &self.roads.stop_lines {
            if line.connectors.iter().any(|connector| red.contains(connector)) {
                let ground = Ground::inside(line.outline.clone());
                consider(&ground, 0.0, &|| Leader::StopLine(line.id.clone()));
            }
        }
        let path_end = || {
            let (distance, rear) = (own.path_left(), 0.5 * own.object().length);
            Lead { leader: Leader::PathEnd, distance, speed: 0.0, rear }
        };
        nearest.map_or_else(path_end, |(_, lead)| lead)
    }
}
