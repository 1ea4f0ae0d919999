//! Memory of an episode: the pieces of the road, and the route and LSTM state of each vehicle.

use reactsim_scene::{AgentKind, CURRENT, Start};

use super::Parameters;
use super::network::HIDDEN;
use super::road::RoadPieces;
use super::route::Route;

/// A vehicle that the network drives.
#[derive(Debug)]
pub(super) struct Vehicle {
    /// Index of the agent.
    pub(super) agent: usize,
    /// Length, metres.
    pub(super) length: f64,
    pub(super) route: Route,
    /// Speed limit, m/s.
    pub(super) limit: f64,
    /// Hidden state of the LSTM.
    pub(super) hidden: Vec<f32>,
    /// Cell state of the LSTM.
    pub(super) cell: Vec<f32>,
}

/// Memory of an episode.
#[derive(Debug)]
pub(super) struct EpisodeMemory {
    pub(super) road: RoadPieces,
    /// Vehicles in the order of the agents, the AV first.
    pub(super) vehicles: Vec<Vehicle>,
}

impl EpisodeMemory {
    pub(super) fn begin(start: &Start, parameters: &Parameters) -> Self {
        let vehicles = (0..start.agents.len()).filter_map(|agent| {
            let properties = &start.agents[agent];
            // The AV drives in the realism protocol, parked or not.
            if properties.kind != AgentKind::Vehicle {
                return None;
            }
            let now = start.now(agent);
            let route = Route::from(&start.road(), now.position(), now.heading);
            if agent > 0 && is_parked(start, agent, &route, parameters) {
                return None;
            }
            let speed = now.velocity().map_or(0.0, |v| v.norm());
            let limit = route.limit.unwrap_or(parameters.speed_limit).max(speed);
            let zeros = || vec![0.0; HIDDEN];
            Some(Vehicle { agent, length: properties.length, route, limit, hidden: zeros(), cell: zeros() })
        });
        Self { vehicles: vehicles.collect(), road: RoadPieces::of(&start.map) }
    }

    /// Returns this memory with the vehicles of another one, which go on as they were: parked ones stay parked.
    /// `kept`: the slots that the agents had there.
    pub(super) fn resumed(self, before: Self, kept: &[Option<usize>]) -> Self {
        let mut earlier = before.vehicles;
        let mut resumed = |vehicle: Vehicle| {
            let Some(slot) = kept[vehicle.agent] else { return Some(vehicle) };
            let at = earlier.iter().position(|other| other.agent == slot)?;
            Some(Vehicle { agent: vehicle.agent, ..earlier.swap_remove(at) })
        };
        Self { vehicles: self.vehicles.into_iter().filter_map(&mut resumed).collect(), ..self }
    }
}

/// Returns whether a vehicle is parked: it has not moved in the history, and it is next to the lanes or
/// at an angle to them.
fn is_parked(start: &Start, agent: usize, route: &Route, parameters: &Parameters) -> bool {
    let bounds = &parameters.parked;
    let now = start.now(agent);
    let seen = start.history[agent][..CURRENT].iter().flatten();
    let moved = seen.map(|s| (s.position() - now.position()).norm()).fold(0.0, f64::max);
    if moved > bounds.travel || now.velocity().is_some_and(|v| v.norm() > bounds.speed) {
        return false;
    }
    route.offset.is_none_or(|(aside, angle)| aside > bounds.offset || angle > bounds.angle)
}
