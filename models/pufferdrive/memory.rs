//! Memory of an episode: the pieces of the road, and the route and LSTM state of each vehicle.

use reactsim_rollout::Observation;
use reactsim_scene::{AgentKind, AgentState, FUTURE, Road, Start};

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
    /// Step of the episode at which the route began.
    routed: usize,
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
            let (route, limit) = route(&start.road(), &start.now(agent), parameters);
            if agent > 0 && is_parked(start, agent, &route, parameters) {
                return None;
            }
            let (hidden, cell) = (vec![0.0; HIDDEN], vec![0.0; HIDDEN]);
            Some(Vehicle { agent, length: properties.length, route, routed: 0, limit, hidden, cell })
        });
        Self { vehicles: vehicles.collect(), road: RoadPieces::of(&start.map) }
    }

    /// Returns this memory with the vehicles of another one, which go on as they were: parked ones stay
    /// parked.
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

impl Vehicle {
    /// Begins a new route, and forgets the past, unless the route is long enough for a plan of `steps` steps.
    /// Routes cover 8 s, and the network was trained in episodes of 9 s.
    pub(super) fn renew(&mut self, seen: &Observation<'_>, steps: usize, parameters: &Parameters) {
        let now = seen.step();
        if now == self.routed || now + steps <= self.routed + FUTURE {
            return;
        }
        let Some(state) = seen.state(self.agent) else { return };
        self.routed = now;
        (self.route, self.limit) = route(&seen.start().road(), &state, parameters);
        self.hidden.fill(0.0);
        self.cell.fill(0.0);
    }
}

/// Returns the route of a vehicle and its speed limit, m/s, which is not below its speed.
fn route(road: &Road<'_>, state: &AgentState, parameters: &Parameters) -> (Route, f64) {
    let route = Route::from(road, state.position(), state.heading);
    let speed = state.velocity().map_or(0.0, |v| v.norm());
    let limit = route.limit.unwrap_or(parameters.speed_limit).max(speed);
    (route, limit)
}

/// Returns whether a vehicle is parked: it has not moved in the history, and it is next to the lanes or
/// at an angle to them.
fn is_parked(start: &Start, agent: usize, route: &Route, parameters: &Parameters) -> bool {
    let bounds = &parameters.parked;
    let now = start.now(agent);
    let seen = start.history[agent][..start.current()].iter().flatten();
    let moved = seen.map(|s| (s.position() - now.position()).norm()).fold(0.0, f64::max);
    if moved > bounds.travel || now.velocity().is_some_and(|v| v.norm() > bounds.speed) {
        return false;
    }
    route.offset.is_none_or(|(aside, angle)| aside > bounds.offset || angle > bounds.angle)
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_scene::{Agent, Frame, LoggedAgent, Scenario, ScenarioParts};

    use super::super::ParkedCriteria;
    use super::*;

    #[test]
    fn vehicles_begin_a_new_route_every_eight_seconds() {
        let at = |f: usize| Some(AgentState { x: f as f64, y: 2.0, heading: 0.0, vx: 10.0, vy: 0.0 });
        let agent = Agent { id: "av".into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
        let logged = LoggedAgent { agent, track: (0..91).map(at).collect(), heights: Vec::new() };
        let parts = ScenarioParts { id: "av".into(), agents: vec![logged], ..Default::default() };
        let scenario = Scenario::assemble(parts).unwrap();
        let parameters = Parameters {
            projection: true,
            greedy: true,
            goal_seconds: 3.0,
            goal_nearest: 30.0,
            goal_farthest: 60.0,
            speed_limit: 13.4,
            parked: ParkedCriteria { travel: 0.3, speed: 0.3, offset: 1.6, angle: 0.6 },
        };
        let mut vehicle = EpisodeMemory::begin(&scenario.start, &parameters).vehicles.remove(0);
        let mut renewed = Vec::new();
        for step in (0..400).step_by(5) {
            let tracks: [Vec<Frame>; 1] = [(0..=10 + step).map(at).collect()];
            vehicle.hidden.fill(1.0);
            vehicle.renew(&Observation::new(&scenario.start, &tracks, &[], None), 5, &parameters);
            if vehicle.hidden.iter().all(|h| *h == 0.0) {
                renewed.push(step);
                // Off the lanes the route leads straight ahead from where the vehicle is.
                let ahead = vehicle.route.ahead(Vec2::new((10 + step) as f64, 2.0), 30.0);
                assert!((ahead - Vec2::new((40 + step) as f64, 2.0)).norm() < 1e-9, "{ahead}");
            }
        }
        assert_eq!(renewed, [80, 160, 240, 320]);
    }
}
