//! Simulation of traffic from one step to the next.

use reactsim_rollout::Stream;
use reactsim_scene::{DT, LightState};

use super::arrivals::{self, Arrivals};
use super::changing::{self, LaneChangeIntent};
use super::driver::Manner;
use super::encounters::Encounters;
use super::following::Leader;
use super::free_road::free_acceleration;
use super::network::Network;
use super::occupancy::{self, LaneOccupancy};
use super::people::Crowd;
use super::routes::Routes;
use super::vehicle::Vehicle;
use super::yielding::{DriverMemory, Sight};
use crate::Layout;

/// Interval between two decisions of a driver, s: one per recorded frame.
pub(super) const DECISION_INTERVAL: f64 = DT;
/// Number of motion steps per decision.
const MOTION_STEPS: usize = 2;
/// Number of decisions between two evaluations of lane changes.
const LANE_DECISION_PERIOD: u32 = 5;
/// Minimum time between two lane changes of a vehicle, s.
const MIN_CHANGE_INTERVAL: f64 = 4.0;
/// Braking to let another vehicle in, m/s²; scaled by the driver's politeness.
const COURTESY_BRAKING: f64 = 1.2;

/// A map with its traffic.
pub(super) struct World<'a> {
    layout: &'a Layout,
    pub(super) network: Network,
    routes: Routes,
    arrivals: Arrivals,
    pub(super) vehicles: Vec<Vehicle>,
    occupancy: LaneOccupancy,
    /// Current states of the signal plans.
    pub(super) lights: Vec<LightState>,
    pub(super) encounters: Encounters,
    pub(super) time: f64,
    tick: u32,
    rng: Stream,
}

struct Decision {
    acceleration: f64,
    held_before: Option<usize>,
    memory: DriverMemory,
    intent: LaneChangeIntent,
}

impl<'a> World<'a> {
    /// Creates a map with vehicles on it.
    pub(super) fn new(layout: &'a Layout, density: f64, manner: Manner, mut rng: Stream) -> Self {
        let network = Network::new(layout);
        let routes = Routes::new(&network);
        let mut arrivals = Arrivals::new(&network, layout, density, manner, &mut rng);
        let vehicles = arrivals.fill(&network, &routes, &mut rng);
        let crowd = Crowd::new(layout, density, &mut rng);
        let encounters = Encounters::new(layout, &network, crowd);
        let mut world = Self {
            layout,
            network,
            routes,
            arrivals,
            vehicles,
            occupancy: LaneOccupancy::default(),
            lights: Vec::new(),
            encounters,
            time: 0.0,
            tick: 0,
            rng,
        };
        world.observe();
        world
    }

    /// Lets all drivers decide, and moves them until the next decision.
    pub(super) fn step(&mut self) {
        let decisions: Vec<Decision> = (0..self.vehicles.len()).map(|i| self.decide(i)).collect();
        let mut accelerations: Vec<f64> = decisions.iter().map(|d| d.acceleration).collect();
        for (i, decision) in decisions.iter().enumerate() {
            self.remember(i, decision);
            match decision.intent {
                LaneChangeIntent::Stay => {}
                LaneChangeIntent::Change { lane } => self.change(i, lane),
                LaneChangeIntent::LetIn { lane, s } => self.let_in(i, lane, s, &mut accelerations),
            }
        }
        for (v, &acceleration) in self.vehicles.iter_mut().zip(&accelerations) {
            v.drift(DECISION_INTERVAL, &mut self.rng);
            let before = next_line(&self.network, v);
            for _ in 0..MOTION_STEPS {
                v.advance(&self.network, acceleration, DECISION_INTERVAL / MOTION_STEPS as f64);
            }
            v.passed_red = before.is_some_and(|(lane, distance)| {
                let light = self.network.lanes[lane].light.map(|l| self.lights[l]);
                distance > 0.0
                    && light.is_some_and(LightState::is_red)
                    && !is_before_line(&self.network, v, lane)
            });
        }
        self.encounters.step(self.layout, &self.network, &self.vehicles, self.time, DECISION_INTERVAL);
        self.time += DECISION_INTERVAL;
        self.tick += 1;
        self.exchange_vehicles();
        self.observe();
    }

    /// Updates the lanes' vehicles and the lights that drivers see.
    fn observe(&mut self) {
        let time = self.time;
        self.lights = self.layout.signals.iter().map(|s| s.at(time).unwrap_or(LightState::Unknown)).collect();
        self.occupancy.update(&self.network, &self.vehicles);
    }

    fn decide(&mut self, i: usize) -> Decision {
        let ahead = {
            let v = &self.vehicles[i];
            let found =
                self.occupancy.leader(&self.network, &self.vehicles, &v.path, (i, v.s, v.body.length));
            found.map(|(leader, j)| (leader, self.vehicles[j].id))
        };
        let seen = self.vehicles[i].perceive(ahead, DECISION_INTERVAL);
        let sight = Sight {
            network: &self.network,
            vehicles: &self.vehicles,
            occupancy: &self.occupancy,
            lights: &self.lights,
            encounters: &self.encounters,
            time: self.time,
        };
        let (wait, memory) = sight.wait(i);
        let zip_acceleration = sight.zip_acceleration(i);
        let beside = self.leader_on_old_lane(i);
        let v = &self.vehicles[i];
        let free = free_acceleration(&self.network, v);
        let behind = seen.map_or(f64::INFINITY, |leader| v.driver.behind(v.speed, leader));
        let mut acceleration = free.min(behind);
        if let Some(leader) = beside {
            acceleration = acceleration.min(v.driver.behind(v.speed, leader));
        }
        acceleration = acceleration.min(zip_acceleration.unwrap_or(f64::INFINITY));
        if let Some(wait) = wait {
            acceleration = acceleration.min(v.driver.stop_in(v.speed, wait.distance));
        }
        let evaluates = (v.id + self.tick).is_multiple_of(LANE_DECISION_PERIOD)
            && v.change.is_none()
            && self.time - v.changed_at > MIN_CHANGE_INTERVAL
            && !self.network.lanes[v.path[0]].connector;
        let intent = if evaluates {
            let map = (&self.network, &self.routes, &self.occupancy);
            changing::evaluate(map, &self.vehicles, i, (free, behind))
        } else {
            LaneChangeIntent::Stay
        };
        Decision { acceleration, held_before: wait.and_then(|w| w.lane), memory, intent }
    }

    /// Returns the leader on the lane that a vehicle is leaving, until the vehicle no longer blocks that
    /// lane.
    fn leader_on_old_lane(&self, i: usize) -> Option<Leader> {
        let v = &self.vehicles[i];
        let from = v.change.and_then(|c| c.from)?;
        let s = occupancy::leaving(&self.network.lanes[v.path[0]], from, v)?;
        let found = self.occupancy.leader(&self.network, &self.vehicles, &[from], (i, s, v.body.length));
        found.map(|(leader, _)| leader)
    }

    fn remember(&mut self, i: usize, decision: &Decision) {
        let time = self.time;
        let v = &mut self.vehicles[i];
        v.held_before = decision.held_before;
        v.passes_yellow = decision.memory.passes_yellow;
        if let Some(lane) = decision.memory.stopped_at_sign
            && v.stopped.is_none_or(|s| s.0 != lane)
        {
            v.stopped = Some((lane, time));
        }
        if v.stopped.is_some_and(|(lane, _)| !v.path.contains(&lane)) {
            v.stopped = None;
        }
        if v.speed > 0.3 {
            v.standing_since = f64::INFINITY;
        } else if v.standing_since.is_infinite() {
            v.standing_since = time;
        }
    }

    fn change(&mut self, i: usize, lane: usize) {
        let path = arrivals::path_from(&self.network, &self.routes, self.vehicles[i].goal, lane);
        let v = &self.vehicles[i];
        let found = self.network.lanes[lane].line.project(v.pose().position);
        // Two vehicles may have chosen the same gap at once; the list already contains the first one.
        let length = v.body.length;
        let beside = |j: usize| 0.5 * (self.vehicles[j].body.length + length) + 1.0;
        let taken = self.occupancy.on(lane).iter().any(|&(at, j)| j != i && (at - found.s).abs() < beside(j));
        if !taken {
            let v = &mut self.vehicles[i];
            v.begin_change(found.s, found.offset, path);
            v.changed_at = self.time;
            self.occupancy.update(&self.network, &self.vehicles);
        }
    }

    /// Makes the vehicle behind, on the lane that a vehicle must change to, leave room.
    fn let_in(&self, i: usize, lane: usize, s: f64, accelerations: &mut [f64]) {
        let v = &self.vehicles[i];
        if let Some((at, j)) = self.occupancy.last_before(lane, s - 1.0, i) {
            let f = &self.vehicles[j];
            let gap = s - at - 0.5 * (v.body.length + f.body.length);
            let desired = f.driver.behind(f.speed, Leader { gap, speed: v.speed });
            accelerations[j] =
                accelerations[j].min(desired.max(-COURTESY_BRAKING * (0.5 + f.driver.politeness)));
        }
        // The vehicle that must change falls in behind the leader on that lane.
        if let Some((at, j)) = self.occupancy.first_after(lane, s - 1.0, i) {
            let l = &self.vehicles[j];
            let gap = at - s - 0.5 * (v.body.length + l.body.length);
            let desired = v.driver.behind(v.speed, Leader { gap: gap.max(0.5), speed: l.speed });
            accelerations[i] = accelerations[i].min(desired.max(-COURTESY_BRAKING));
        }
    }

    fn exchange_vehicles(&mut self) {
        let (network, routes) = (&self.network, &self.routes);
        for v in &mut self.vehicles {
            arrivals::extend(network, routes, v.goal, &mut v.path);
            if v.path.len() > 1 {
                continue;
            }
            let lane = &network.lanes[v.path[0]];
            let braking = 8.0 + v.speed * v.speed / (2.0 * 2.0);
            if !lane.next.is_empty() && lane.length - v.s < braking {
                // Too late to reach the lane that leads to the goal: take a new goal on this lane's route.
                if let Some(goal) = routes.draw_goal_from(network, v.path[0], &mut self.rng) {
                    v.goal = goal;
                    arrivals::extend(network, routes, goal, &mut v.path);
                }
            }
        }
        self.vehicles.retain(|v| v.path.len() > 1 || v.s < network.lanes[v.path[0]].length);
        let rear = |lane: usize| {
            let mut last: Option<(f64, f64)> = None;
            // Vehicles that are leaving the lane still occupy it for a while.
            let leaves = |v: &Vehicle| v.change.and_then(|c| c.from) == Some(lane);
            for v in self.vehicles.iter().filter(|v| v.path[0] == lane || leaves(v)) {
                let end = v.s - 0.5 * v.body.length;
                if last.is_none_or(|l| end < l.0) {
                    last = Some((end, v.speed));
                }
            }
            last
        };
        let new = self.arrivals.step((network, routes), self.time, rear, &mut self.rng);
        self.vehicles.extend(new);
    }
}

/// Returns the next lane of a path, and the distance from the front bumper to its beginning, metres.
fn next_line(network: &Network, v: &Vehicle) -> Option<(usize, f64)> {
    Some((*v.path.get(1)?, network.lanes[v.path[0]].length - v.front()))
}

/// Whether the front bumper is still before the beginning of `lane`.
fn is_before_line(network: &Network, v: &Vehicle, lane: usize) -> bool {
    v.path[0] != lane && next_line(network, v).is_some_and(|(_, distance)| distance > 0.0)
}

#[cfg(test)]
mod tests {
    use reactsim_rollout::{Purpose, stream};

    use super::*;
    use crate::maps;

    /// On every map type, no vehicle leaves its lane, and none stands for ever.
    #[test]
    fn drivers_stay_in_their_lanes() {
        for kind in maps::all() {
            for (seed, manner) in (0..4).flat_map(|seed| [(seed, Manner::CALM), (seed, Manner::BRISK)]) {
                let layout = kind.layout(&mut stream(seed, kind.id, 0, Purpose::Map));
                let mut world = World::new(&layout, 1.0, manner, stream(seed, kind.id, 0, Purpose::Traffic));
                for _ in 0..900 {
                    world.step();
                    for v in &world.vehicles {
                        let lane = &world.network.lanes[v.path[0]];
                        let astray = v.change.is_none() && v.offset.abs() > lane.half_width + 0.3;
                        assert!(
                            !astray,
                            "{} seed {seed} time {:.1}: vehicle {} ({:.1} m) is {:.1} m beside {} \
                             at {:.1} of {:.1}, {:.1} m/s",
                            kind.id,
                            world.time,
                            v.id,
                            v.body.length,
                            v.offset,
                            layout.map.lanes[v.path[0]].id,
                            v.s,
                            lane.length,
                            v.speed
                        );
                        let stands = world.time - v.standing_since;
                        assert!(stands < 120.0, "{} seed {seed}: vehicle {} stands for ever", kind.id, v.id);
                    }
                }
            }
        }
    }
}
