//! Who comes into the map: at the beginning everywhere, later at its entries.

use super::driver::Driver;
use super::fleet::{Class, Size};
use super::network::Network;
use super::routes::Routes;
use super::vehicle::{Body, Vehicle};
use crate::generation::{Draw, Layout};
use crate::rollout::Stream;

/// Time headway of those who come in, at least, s, and room behind the last one, metres.
const HEADWAY: f64 = 1.3;
const ROOM: f64 = 4.0;
/// Room that is kept free for a newcomer, metres; who is longer takes some of that to the next one.
const NEWCOMER: f64 = 7.0;
/// Vehicles that want to come in but find no room give up beyond this number.
const QUEUE: u32 = 5;
/// Vehicles shorter than this get round every bend, metres.
const LONG: f64 = 6.2;
/// Who must change lanes has at least this way before the end of the lane, metres.
const ROOM_TO_CHANGE: f64 = 90.0;
/// Ways ahead that are part of a path, and how far it leads at least, metres.
const AHEAD: usize = 6;
const FAR: f64 = 150.0;
/// Nobody is put nearer to the end of a way than this at the beginning, metres.
const CLEAR: f64 = 6.0;

/// An entry and what comes there.
struct Gate {
    way: usize,
    /// Vehicles per second.
    rate: f64,
    /// When the next one comes, s.
    next: f64,
    waiting: u32,
}

/// Lets vehicles come in.
pub(super) struct Arrivals {
    gates: Vec<Gate>,
    next_id: u32,
}

impl Arrivals {
    /// The entries of a layout, with `density` times their flow.
    pub(super) fn new(network: &Network, layout: &Layout, density: f64, rng: &mut Stream) -> Self {
        let gates = layout.entries.iter().filter_map(|entry| {
            let rate = density * entry.flow / 3600.0;
            let next = interval(rate, rng);
            Some(Gate { way: network.find(&entry.lane)?, rate, next, waiting: 0 })
        });
        Self { gates: gates.collect(), next_id: 0 }
    }

    /// Puts vehicles on a way from each entry through the map, as far apart as its flow has them.
    pub(super) fn fill(&mut self, network: &Network, routes: &Routes, rng: &mut Stream) -> Vec<Vehicle> {
        let mut vehicles = Vec::new();
        for g in 0..self.gates.len() {
            let (mut way, rate) = (self.gates[g].way, self.gates[g].rate);
            let mut seen = Vec::new();
            let mut left = Self::spacing(network, way, rate, rng);
            loop {
                let length = network.ways[way].length;
                seen.push(way);
                let mut s = left;
                while s < length {
                    let clear = s < length - CLEAR && s > CLEAR && !network.ways[way].connector;
                    if clear && let Some(v) = self.draw(network, routes, way, s, rng) {
                        vehicles.push(v);
                    }
                    s += Self::spacing(network, way, rate, rng);
                }
                left = s - length;
                let next: Vec<usize> =
                    network.ways[way].next.iter().copied().filter(|n| !seen.contains(n)).collect();
                if next.is_empty() {
                    break;
                }
                way = *rng.pick(&next);
            }
        }
        space_out(network, &mut vehicles);
        vehicles
    }

    /// Distance between two who come one after the other, metres.
    fn spacing(network: &Network, way: usize, rate: f64, rng: &mut Stream) -> f64 {
        let speed = if network.ways[way].bicycles { 5.0 } else { 0.85 * network.ways[way].limit };
        (speed * interval(rate, rng)).max(speed * HEADWAY + 7.0)
    }

    /// Those who come in during a step; `rear` tells for a way where the last one on it ends and how fast it is.
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
                self.gates[g].waiting = (self.gates[g].waiting + 1).min(QUEUE);
            }
            if self.gates[g].waiting == 0 {
                continue;
            }
            let way = self.gates[g].way;
            let last = rear(way);
            if last.is_some_and(|(end, speed)| end < NEWCOMER + ROOM + speed.max(2.0) * HEADWAY) {
                continue;
            }
            self.gates[g].waiting -= 1;
            if let Some(mut v) = self.draw(network, routes, way, 0.0, rng) {
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
        way: usize,
        s: f64,
        rng: &mut Stream,
    ) -> Option<Vehicle> {
        let goal = routes.draw_goal(network, way, rng)?;
        let path = path_from(network, routes, goal, way);
        // Nobody begins where there is no room left to change to the lane that leads to the goal.
        if path.len() == 1
            && !network.ways[way].next.is_empty()
            && network.ways[way].length - s < ROOM_TO_CHANGE
        {
            return None;
        }
        let bicycle = network.ways[way].bicycles;
        let size = if bicycle {
            Size::bicycle(rng)
        } else {
            suited((network, routes), goal, way, Size::draw(rng), rng)
        };
        let driver =
            if bicycle { Driver::of_bicycle(rng) } else { Driver::of_car(size.acceleration_factor(), rng) };
        let body = Body::of(&size);
        let bend = driver.in_bend(network.ways[way].bend_at(s));
        // Who is put near a junction can still turn and stop.
        let (mut slowed, mut distance) = (f64::INFINITY, network.ways[way].length - s);
        for &w in &path[1..] {
            let way = &network.ways[w];
            let there = driver.in_bend(way.tightest()).min(if way.connector { 4.0 } else { f64::INFINITY });
            slowed = (there * there + 3.0 * distance.max(0.0)).sqrt().min(slowed);
            distance += way.length;
        }
        let speed = driver.wanted(network.ways[way].limit).min(bend).min(slowed);
        self.next_id += 1;
        Some(Vehicle::new(network, self.next_id, body, driver, path, goal, s, 0.9 * speed))
    }
}

/// Who could not drive round the bends on the way to the goal comes in a car instead.
fn suited(
    (network, routes): (&Network, &Routes),
    goal: usize,
    from: usize,
    size: Size,
    rng: &mut Stream,
) -> Size {
    if size.length < LONG {
        return size;
    }
    let (mut way, mut tightest) = (from, 0.0);
    for _ in 0..network.ways.len() {
        tightest = network.ways[way].tightest().max(tightest);
        // Other lanes of the same road bend alike; who changes to one takes its turns.
        let beside = network.ways[way].left.iter().chain(&network.ways[way].right).map(|b| b.way);
        let cheapest = |a: &usize, b: &usize| routes.cost(goal, *a).total_cmp(&routes.cost(goal, *b));
        let lane = routes.next(network, goal, way).or_else(|| beside.min_by(cheapest));
        match lane {
            Some(next) => way = next,
            None => break,
        }
    }
    // Some room for what the tail cuts off.
    let drives = tightest * (size.turning_radius() + 0.4 * size.length) < 1.0;
    if drives { size } else { Size::of(Class::Car, rng) }
}

/// Seconds until the next one comes.
fn interval(rate: f64, rng: &mut Stream) -> f64 {
    crate::generation::draw::exponential(rng) / rate.max(1e-6)
}

/// Takes out vehicles until nobody is too close behind another.
fn space_out(network: &Network, vehicles: &mut Vec<Vehicle>) {
    let mut kept: Vec<Vehicle> = Vec::with_capacity(vehicles.len());
    for v in vehicles.drain(..) {
        let way = &network.ways[v.path[0]];
        let near = |o: &Vehicle| {
            let both = 0.5 * (v.body.length + o.body.length);
            let gap = (v.s - o.s).abs() - both;
            o.path[0] == v.path[0] && gap < 3.0 + HEADWAY * 0.8 * v.speed.max(o.speed).min(way.limit)
        };
        if !kept.iter().any(near) {
            kept.push(v);
        }
    }
    *vehicles = kept;
}

/// The path from a way towards a goal, as far as drivers plan.
pub(super) fn path_from(network: &Network, routes: &Routes, goal: usize, way: usize) -> Vec<usize> {
    let mut path = vec![way];
    extend(network, routes, goal, &mut path);
    path
}

/// Goes on with a path until it is long enough.
pub(super) fn extend(network: &Network, routes: &Routes, goal: usize, path: &mut Vec<usize>) {
    let mut length: f64 = path.iter().skip(1).map(|&w| network.ways[w].length).sum();
    while path.len() < AHEAD || length < FAR {
        let Some(next) = routes.next(network, goal, path[path.len() - 1]) else { return };
        length += network.ways[next].length;
        path.push(next);
        if path.len() > 40 {
            return;
        }
    }
}
