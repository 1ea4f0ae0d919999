//! Arrival of vehicles: everywhere at the beginning, later at the entries of the map.

use reactsim_rollout::Stream;

use super::driver::{Driver, Manner};
use super::fleet::{Class, Size};
use super::network::Network;
use super::routes::Routes;
use super::vehicle::{Body, Vehicle};
use crate::{Draw, Layout};

/// Minimum time headway of arriving vehicles, s.
const MIN_TIME_HEADWAY: f64 = 1.3;
/// Minimum gap of an arriving vehicle to the last one on its lane, metres.
const MIN_ENTRY_GAP: f64 = 4.0;
/// Length reserved for an arriving vehicle, metres; longer vehicles reduce the gap to the next one.
const NEWCOMER_LENGTH: f64 = 7.0;
/// Maximum number of vehicles that wait to enter; further ones give up.
const MAX_WAITING: u32 = 5;
/// Length, metres, below which vehicles can drive every bend.
const LONG_VEHICLE: f64 = 6.2;
/// Minimum distance in metres to the end of the lane for a mandatory lane change.
const CHANGE_DISTANCE: f64 = 90.0;
/// Minimum number of lanes of a path.
const MIN_PATH_LANES: usize = 6;
/// Minimum length of a path beyond its first lane, metres.
const MIN_PATH_LENGTH: f64 = 150.0;
/// Minimum distance of initial vehicles from the ends of their lane, metres.
const END_CLEARANCE: f64 = 6.0;

/// An entry of the map and its arrival process.
struct Gate {
    lane: usize,
    /// Arrival rate, vehicles per second.
    rate: f64,
    /// Time of the next arrival, s.
    next: f64,
    waiting: u32,
}

pub(super) struct Arrivals {
    gates: Vec<Gate>,
    manner: Manner,
    next_id: u32,
}

impl Arrivals {
    /// Creates the entries of a layout, with `density` times their flow.
    pub(super) fn new(
        network: &Network,
        layout: &Layout,
        density: f64,
        manner: Manner,
        rng: &mut Stream,
    ) -> Self {
        let gates = layout.entries.iter().filter_map(|entry| {
            let rate = density * entry.flow / 3600.0;
            let next = interval(rate, rng);
            Some(Gate { lane: network.find(&entry.lane)?, rate, next, waiting: 0 })
        });
        Self { gates: gates.collect(), manner, next_id: 0 }
    }

    /// Places vehicles on a random route from each entry through the map, spaced according to its flow.
    pub(super) fn fill(&mut self, network: &Network, routes: &Routes, rng: &mut Stream) -> Vec<Vehicle> {
        let mut vehicles = Vec::new();
        for g in 0..self.gates.len() {
            let (mut lane, rate) = (self.gates[g].lane, self.gates[g].rate);
            let mut seen = Vec::new();
            let mut left = Self::spacing(network, lane, rate, rng);
            loop {
                let length = network.lanes[lane].length;
                seen.push(lane);
                let mut s = left;
                while s < length {
                    let clear =
                        s < length - END_CLEARANCE && s > END_CLEARANCE && !network.lanes[lane].connector;
                    if clear && let Some(v) = self.draw(network, routes, lane, s, rng) {
                        vehicles.push(v);
                    }
                    s += Self::spacing(network, lane, rate, rng);
                }
                left = s - length;
                let next: Vec<usize> =
                    network.lanes[lane].next.iter().copied().filter(|n| !seen.contains(n)).collect();
                if next.is_empty() {
                    break;
                }
                lane = *rng.pick(&next);
            }
        }
        space_out(network, &mut vehicles);
        vehicles
    }

    /// Draws the distance between two successive vehicles, metres.
    fn spacing(network: &Network, lane: usize, rate: f64, rng: &mut Stream) -> f64 {
        let speed = if network.lanes[lane].bicycles { 5.0 } else { 0.85 * network.lanes[lane].limit };
        (speed * interval(rate, rng)).max(speed * MIN_TIME_HEADWAY + 7.0)
    }

    /// Returns the vehicles that enter during a step; `rear` gives the rear bumper position and the speed
    /// of the last vehicle on a lane.
    pub(super) fn step(
        &mut self,
        (network, routes): (&Network, &Routes),
        time: f64,
        rear: impl Fn(usize) -> Option<(f64, f64)>,
        rng: &mut Stream,
    ) -> Vec<Vehicle> {
        let mut new = Vec::new();
        for g in 0..self.gates.len() {
            while self.gates[g].next <= time {
                self.gates[g].next += interval(self.gates[g].rate, rng);
                self.gates[g].waiting = (self.gates[g].waiting + 1).min(MAX_WAITING);
            }
            if self.gates[g].waiting == 0 {
                continue;
            }
            let lane = self.gates[g].lane;
            let last = rear(lane);
            if last.is_some_and(|(end, speed)| {
                end < NEWCOMER_LENGTH + MIN_ENTRY_GAP + speed.max(2.0) * MIN_TIME_HEADWAY
            }) {
                continue;
            }
            self.gates[g].waiting -= 1;
            if let Some(mut v) = self.draw(network, routes, lane, 0.0, rng) {
                v.place(network, 0.5 * v.body.length);
                if let Some((end, speed)) = last {
                    let gap = (end - v.front() - v.driver.gap).max(0.0);
                    v.speed = v.speed.min(speed + (1.5 * gap).sqrt());
                }
                new.push(v);
            }
        }
        new
    }

    fn draw(
        &mut self,
        network: &Network,
        routes: &Routes,
        lane: usize,
        s: f64,
        rng: &mut Stream,
    ) -> Option<Vehicle> {
        let goal = routes.draw_goal(network, lane, rng)?;
        let path = path_from(network, routes, goal, lane);
        // No vehicle starts without enough room to change to the lane that leads to its goal.
        if path.len() == 1
            && !network.lanes[lane].next.is_empty()
            && network.lanes[lane].length - s < CHANGE_DISTANCE
        {
            return None;
        }
        let bicycle = network.lanes[lane].bicycles;
        let size = if bicycle {
            Size::bicycle(rng)
        } else {
            suitable_size((network, routes), goal, lane, Size::draw(rng), rng)
        };
        let driver =
            if bicycle { Driver::of_bicycle(rng) } else { Driver::of_car(size.acceleration_factor(), rng) };
        let driver = driver.with(&self.manner);
        let body = Body::of(&size);
        let bend = driver.in_bend(network.lanes[lane].curvature_at(s));
        // A vehicle placed near a junction must still be able to turn and stop.
        let (mut slowed, mut distance) = (f64::INFINITY, network.lanes[lane].length - s);
        for &index in &path[1..] {
            let lane = &network.lanes[index];
            let there =
                driver.in_bend(lane.max_curvature).min(if lane.connector { 4.0 } else { f64::INFINITY });
            slowed = (there * there + 3.0 * distance.max(0.0)).sqrt().min(slowed);
            distance += lane.length;
        }
        let speed = driver.wanted(network.lanes[lane].limit).min(bend).min(slowed);
        self.next_id += 1;
        Some(Vehicle::new(network, self.next_id, body, driver, path, goal, s, 0.9 * speed))
    }
}

/// Returns a car instead of a vehicle that is too large for the bends on the route to the goal.
fn suitable_size(
    (network, routes): (&Network, &Routes),
    goal: usize,
    from: usize,
    size: Size,
    rng: &mut Stream,
) -> Size {
    if size.length < LONG_VEHICLE {
        return size;
    }
    let (mut lane, mut max_curvature) = (from, 0.0);
    for _ in 0..network.lanes.len() {
        max_curvature = network.lanes[lane].max_curvature.max(max_curvature);
        // Other lanes of the same road have similar curvature; after a change the vehicle takes the turns
        // of its new lane.
        let beside = network.lanes[lane].left.iter().chain(&network.lanes[lane].right).map(|b| b.lane);
        let cheapest = |a: &usize, b: &usize| routes.cost(goal, *a).total_cmp(&routes.cost(goal, *b));
        let next_lane = routes.next(network, goal, lane).or_else(|| beside.min_by(cheapest));
        match next_lane {
            Some(next) => lane = next,
            None => break,
        }
    }
    // Leave some room for the off-tracking of the rear.
    let drives = max_curvature * (size.turning_radius() + 0.4 * size.length) < 1.0;
    if drives { size } else { Size::of(Class::Car, rng) }
}

/// Draws the time until the next arrival, seconds.
fn interval(rate: f64, rng: &mut Stream) -> f64 {
    crate::draw::exponential(rng) / rate.max(1e-6)
}

/// Removes vehicles until none is too close to the next one.
fn space_out(network: &Network, vehicles: &mut Vec<Vehicle>) {
    let mut kept: Vec<Vehicle> = Vec::with_capacity(vehicles.len());
    for v in vehicles.drain(..) {
        let lane = &network.lanes[v.path[0]];
        let near = |o: &Vehicle| {
            let both = 0.5 * (v.body.length + o.body.length);
            let gap = (v.s - o.s).abs() - both;
            o.path[0] == v.path[0]
                && gap < 3.0 + MIN_TIME_HEADWAY * 0.8 * v.speed.max(o.speed).min(lane.limit)
        };
        if !kept.iter().any(near) {
            kept.push(v);
        }
    }
    *vehicles = kept;
}

/// Returns the path from a lane towards a goal, as far as drivers plan.
pub(super) fn path_from(network: &Network, routes: &Routes, goal: usize, lane: usize) -> Vec<usize> {
    let mut path = vec![lane];
    extend(network, routes, goal, &mut path);
    path
}

/// Extends a path until it is long enough.
pub(super) fn extend(network: &Network, routes: &Routes, goal: usize, path: &mut Vec<usize>) {
    let mut length: f64 = path.iter().skip(1).map(|&index| network.lanes[index].length).sum();
    while path.len() < MIN_PATH_LANES || length < MIN_PATH_LENGTH {
        let Some(next) = routes.next(network, goal, path[path.len() - 1]) else { return };
        length += network.lanes[next].length;
        path.push(next);
        if path.len() > 40 {
            return;
        }
    }
}
