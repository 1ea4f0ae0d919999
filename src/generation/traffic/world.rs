//! Traffic from one step to the next.

use super::arrivals::{self, Arrivals};
use super::changing::{self, Wish};
use super::following::Leader;
use super::free_road::unhindered;
use super::lists::{self, Lists};
use super::meeting::Meeting;
use super::network::Network;
use super::people::Crowd;
use super::routes::Routes;
use super::vehicle::Vehicle;
use super::yielding::{Notes, Sight, Walker};
use crate::generation::Layout;
use crate::rollout::Stream;
use crate::scene::{DT, LightState};

/// Drivers decide once per recorded frame, every 0.1 s; the motion goes on in halves of that.
pub(super) const DECISION: f64 = DT;
const MOTIONS: usize = 2;
/// Lane changes are weighed every so many decisions, and how long after a change not at all, s.
const WEIGH_EVERY: u32 = 5;
const REST: f64 = 4.0;
/// Braking to let somebody in, m/s², times what the politeness allows.
const LET_IN: f64 = 1.2;

/// A map with its traffic.
pub(super) struct World<'a> {
    layout: &'a Layout,
    pub(super) network: Network,
    routes: Routes,
    arrivals: Arrivals,
    pub(super) vehicles: Vec<Vehicle>,
    lists: Lists,
    lights: Vec<LightState>,
    pub(super) meeting: Meeting,
    walkers: Vec<Walker>,
    pub(super) time: f64,
    tick: u32,
    rng: Stream,
}

/// What one driver has decided.
struct Decision {
    acceleration: f64,
    held: Option<usize>,
    notes: Notes,
    wish: Wish,
}

impl<'a> World<'a> {
    /// A map with vehicles on it.
    pub(super) fn new(layout: &'a Layout, density: f64, mut rng: Stream) -> Self {
        let network = Network::new(layout);
        let routes = Routes::new(&network);
        let mut arrivals = Arrivals::new(&network, layout, density, &mut rng);
        let vehicles = arrivals.fill(&network, &routes, &mut rng);
        let crowd = Crowd::new(layout, density, &mut rng);
        let meeting = Meeting::new(layout, &network, crowd);
        let mut world = Self {
            layout,
            network,
            routes,
            arrivals,
            vehicles,
            lists: Lists::default(),
            lights: Vec::new(),
            meeting,
            walkers: Vec::new(),
            time: 0.0,
            tick: 0,
            rng,
        };
        world.look();
        world
    }

    /// What the signal plans show now.
    pub(super) fn lights(&self) -> &[LightState] {
        &self.lights
    }

    /// One decision of everybody, and the motion until the next.
    pub(super) fn step(&mut self) {
        let decisions: Vec<Decision> = (0..self.vehicles.len()).map(|i| self.decide(i)).collect();
        let mut accelerations: Vec<f64> = decisions.iter().map(|d| d.acceleration).collect();
        for (i, decision) in decisions.iter().enumerate() {
            self.note(i, decision);
            match decision.wish {
                Wish::Stay => {}
                Wish::Change { way } => self.change(i, way),
                Wish::LetIn { way, s } => self.let_in(i, way, s, &mut accelerations),
            }
        }
        for (v, &acceleration) in self.vehicles.iter_mut().zip(&accelerations) {
            v.drift(DECISION, &mut self.rng);
            let before = next_line(&self.network, v);
            for _ in 0..MOTIONS {
                v.advance(&self.network, acceleration, DECISION / MOTIONS as f64);
            }
            v.passed_red = before.is_some_and(|(way, distance)| {
                let light = self.network.ways[way].light.map(|l| self.lights[l]);
                distance > 0.0
                    && light.is_some_and(LightState::is_red)
                    && !ahead_of_line(&self.network, v, way)
            });
        }
        self.meeting.step(self.layout, &self.network, &self.vehicles, self.time, DECISION);
        self.time += DECISION;
        self.tick += 1;
        self.come_and_go();
        self.look();
    }

    /// Takes note of where everybody is and what the lights show.
    fn look(&mut self) {
        let time = self.time;
        self.lights = self.layout.signals.iter().map(|s| s.at(time).unwrap_or(LightState::Unknown)).collect();
        self.lists.update(&self.network, &self.vehicles);
        self.meeting.walkers(&mut self.walkers);
    }

    fn decide(&mut self, i: usize) -> Decision {
        let ahead = {
            let v = &self.vehicles[i];
            let found = self.lists.leader(&self.network, &self.vehicles, &v.path, (i, v.s, v.body.length));
            found.map(|(leader, j)| (leader, self.vehicles[j].id))
        };
        let seen = self.vehicles[i].perceive(ahead, DECISION);
        let sight = Sight {
            network: &self.network,
            vehicles: &self.vehicles,
            lists: &self.lists,
            lights: &self.lights,
            walkers: &self.walkers,
            time: self.time,
        };
        let (wait, notes) = sight.wait(i);
        let falls_in = sight.falls_in(i);
        let beside = self.leader_on_old_lane(i);
        let v = &self.vehicles[i];
        let free = unhindered(&self.network, v);
        let behind = seen.map_or(f64::INFINITY, |leader| v.driver.behind(v.speed, leader));
        let mut acceleration = free.min(behind);
        if let Some(leader) = beside {
            acceleration = acceleration.min(v.driver.behind(v.speed, leader));
        }
        acceleration = acceleration.min(falls_in.unwrap_or(f64::INFINITY));
        if let Some(wait) = wait {
            acceleration = acceleration.min(v.driver.stop_in(v.speed, wait.distance));
        }
        let weighs = (v.id + self.tick).is_multiple_of(WEIGH_EVERY)
            && v.change.is_none()
            && self.time - v.changed_at > REST
            && !self.network.ways[v.path[0]].connector;
        let wish = if weighs {
            let map = (&self.network, &self.routes, &self.lists);
            changing::weigh(map, &self.vehicles, i, (free, behind))
        } else {
            Wish::Stay
        };
        Decision { acceleration, held: wait.and_then(|w| w.way), notes, wish }
    }

    /// Who is ahead on the lane that a vehicle is leaving, until it is out of that one's way.
    fn leader_on_old_lane(&self, i: usize) -> Option<Leader> {
        let v = &self.vehicles[i];
        let from = v.change.and_then(|c| c.from)?;
        let s = lists::leaving(&self.network.ways[v.path[0]], from, v)?;
        let found = self.lists.leader(&self.network, &self.vehicles, &[from], (i, s, v.body.length));
        found.map(|(leader, _)| leader)
    }

    fn note(&mut self, i: usize, decision: &Decision) {
        let time = self.time;
        let v = &mut self.vehicles[i];
        v.held = decision.held;
        v.passes_yellow = decision.notes.passes_yellow;
        if let Some(way) = decision.notes.stands_at_sign
            && v.stopped.is_none_or(|s| s.0 != way)
        {
            v.stopped = Some((way, time));
        }
        if v.stopped.is_some_and(|(way, _)| !v.path.contains(&way)) {
            v.stopped = None;
        }
        if v.speed > 0.3 {
            v.standing_since = f64::INFINITY;
        } else if v.standing_since.is_infinite() {
            v.standing_since = time;
        }
    }

    fn change(&mut self, i: usize, way: usize) {
        let path = arrivals::path_from(&self.network, &self.routes, self.vehicles[i].goal, way);
        let v = &self.vehicles[i];
        let found = self.network.ways[way].line.project(v.pose().position);
        // Two may have decided for the same room at once: the list of those who are there knows only the first.
        let length = v.body.length;
        let beside = |j: usize| 0.5 * (self.vehicles[j].body.length + length) + 1.0;
        let taken = self.lists.on(way).iter().any(|&(at, j)| j != i && (at - found.s).abs() < beside(j));
        if !taken {
            let v = &mut self.vehicles[i];
            v.begin_change(found.s, found.offset, path);
            v.changed_at = self.time;
            self.lists.update(&self.network, &self.vehicles);
        }
    }

    /// Who is behind on the lane that somebody must change to leaves room for it.
    fn let_in(&self, i: usize, way: usize, s: f64, accelerations: &mut [f64]) {
        let v = &self.vehicles[i];
        if let Some((at, j)) = self.lists.last_before(way, s - 1.0, i) {
            let f = &self.vehicles[j];
            let gap = s - at - 0.5 * (v.body.length + f.body.length);
            let wished = f.driver.behind(f.speed, Leader { gap, speed: v.speed });
            accelerations[j] = accelerations[j].min(wished.max(-LET_IN * (0.5 + f.driver.politeness)));
        }
        // And who wants in falls in behind the one who is ahead there.
        if let Some((at, j)) = self.lists.first_after(way, s - 1.0, i) {
            let l = &self.vehicles[j];
            let gap = at - s - 0.5 * (v.body.length + l.body.length);
            let wished = v.driver.behind(v.speed, Leader { gap: gap.max(0.5), speed: l.speed });
            accelerations[i] = accelerations[i].min(wished.max(-LET_IN));
        }
    }

    fn come_and_go(&mut self) {
        let (network, routes) = (&self.network, &self.routes);
        for v in &mut self.vehicles {
            arrivals::extend(network, routes, v.goal, &mut v.path);
            if v.path.len() > 1 {
                continue;
            }
            let way = &network.ways[v.path[0]];
            let braking = 8.0 + v.speed * v.speed / (2.0 * 2.0);
            if !way.next.is_empty() && way.length - v.s < braking {
                // Too late for the lane that leads to the goal: it goes where this one leads.
                if let Some(goal) = routes.draw_goal_from(network, v.path[0], &mut self.rng) {
                    v.goal = goal;
                    arrivals::extend(network, routes, goal, &mut v.path);
                }
            }
        }
        self.vehicles.retain(|v| v.path.len() > 1 || v.s < network.ways[v.path[0]].length);
        let rear = |way: usize| {
            let mut last: Option<(f64, f64)> = None;
            // Those who are leaving the way are still on it for a while.
            let leaves = |v: &Vehicle| v.change.and_then(|c| c.from) == Some(way);
            for v in self.vehicles.iter().filter(|v| v.path[0] == way || leaves(v)) {
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

/// The next way of a path, and how far ahead of the front bumper it begins, metres.
fn next_line(network: &Network, v: &Vehicle) -> Option<(usize, f64)> {
    Some((*v.path.get(1)?, network.ways[v.path[0]].length - v.front()))
}

/// Whether the front bumper is still before the beginning of `way`.
fn ahead_of_line(network: &Network, v: &Vehicle, way: usize) -> bool {
    v.path[0] != way && next_line(network, v).is_some_and(|(_, distance)| distance > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generation::maps::MAP_TYPES;
    use crate::rollout::{Purpose, stream};

    /// On every map type nobody loses the way, and nobody stands for ever.
    #[test]
    fn drivers_stay_on_their_ways() {
        for kind in MAP_TYPES {
            for seed in 0..4 {
                let layout = kind.layout(&mut stream(seed, kind.id, 0, Purpose::Map));
                let mut world = World::new(&layout, 1.0, stream(seed, kind.id, 0, Purpose::Traffic));
                for _ in 0..900 {
                    world.step();
                    for v in &world.vehicles {
                        let way = &world.network.ways[v.path[0]];
                        let astray = v.change.is_none() && v.offset.abs() > way.half_width + 0.3;
                        assert!(
                            !astray,
                            "{} seed {seed} time {:.1}: vehicle {} ({:.1} m) is {:.1} m beside {} at {:.1} of {:.1}, {:.1} m/s",
                            kind.id,
                            world.time,
                            v.id,
                            v.body.length,
                            v.offset,
                            layout.map.lanes[v.path[0]].id,
                            v.s,
                            way.length,
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
