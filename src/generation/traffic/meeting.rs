//! People and vehicles at crossings: what each sees of the other.

use super::network::Network;
use super::people::{Approach, Crowd, Surroundings, Vehicle as Seen, WalkLight};
use super::vehicle::Vehicle;
use super::yielding::Walker;
use crate::generation::Layout;

/// Vehicles farther than this from a crossing do not matter to people, metres.
const FAR: f64 = 60.0;

/// A crowd, and where vehicles cross its ways.
pub(super) struct Meeting {
    pub(super) crowd: Crowd,
    /// Per footway of the layout, its number among the crowd's crossings.
    numbers: Vec<Option<usize>>,
    /// Per way and crossing on it: arc length along the footway's line at which the way crosses it.
    places: Vec<Vec<f64>>,
    vehicles: Vec<Seen>,
    approaches: Vec<Approach>,
    lights: Vec<WalkLight>,
}

impl Meeting {
    pub(super) fn new(layout: &Layout, network: &Network, crowd: Crowd) -> Self {
        let mut numbers = vec![None; layout.footways.len()];
        for (i, crossing) in crowd.crossings().iter().enumerate() {
            numbers[crossing.footway] = Some(i);
        }
        let place = |way: &super::network::Way, &(f, [from, to]): &(usize, [f64; 2])| {
            layout.footways[f].line.project(way.line.at(0.5 * (from + to))).s
        };
        let places = network.ways.iter().map(|w| w.crossings.iter().map(|c| place(w, c)).collect()).collect();
        Self { crowd, numbers, places, vehicles: Vec::new(), approaches: Vec::new(), lights: Vec::new() }
    }

    /// Everybody on foot walks on for `dt` seconds.
    pub(super) fn step(
        &mut self,
        layout: &Layout,
        network: &Network,
        vehicles: &[Vehicle],
        time: f64,
        dt: f64,
    ) {
        self.vehicles.clear();
        self.approaches.clear();
        self.lights.clear();
        if self.crowd.people().next().is_none() {
            // New people may still come; they look at what is there then.
            self.crowd.step(dt, &Surroundings::default());
            return;
        }
        for v in vehicles {
            let mut start = 0.0;
            let mut near = false;
            for &w in &v.path {
                if start - v.front() > FAR {
                    break;
                }
                for (k, &(footway, [from, to])) in network.ways[w].crossings.iter().enumerate() {
                    let distance = start + from - v.front();
                    let passed = start + to < v.s - 0.5 * v.body.length;
                    let Some(crossing) = self.numbers[footway] else { continue };
                    if distance > FAR || passed {
                        continue;
                    }
                    near |= distance < 15.0;
                    self.approaches.push(Approach {
                        crossing,
                        at: self.places[w][k],
                        distance,
                        speed: v.speed,
                        acceleration: v.acceleration,
                        length: v.body.length,
                        width: v.body.width,
                    });
                }
                start += network.ways[w].length;
            }
            if near {
                let pose = v.pose();
                self.vehicles.push(Seen {
                    position: pose.position,
                    heading: pose.heading,
                    speed: v.speed,
                    acceleration: v.acceleration,
                    length: v.body.length,
                    width: v.body.width,
                });
            }
        }
        for crossing in self.crowd.crossings() {
            self.lights.push(WalkLight::at(layout, crossing.footway, time));
        }
        let surroundings =
            Surroundings { vehicles: &self.vehicles, approaches: &self.approaches, lights: &self.lights };
        self.crowd.step(dt, &surroundings);
    }

    /// Everybody who is on a crossing or about to step on it, as drivers see them.
    pub(super) fn walkers(&self, into: &mut Vec<Walker>) {
        into.clear();
        for crossing in self.crowd.crossings() {
            let footway = crossing.footway;
            into.extend(crossing.people.iter().map(|p| Walker {
                footway,
                position: p.position,
                velocity: p.velocity,
                waits: p.intent == super::people::Intent::Waiting,
            }));
        }
    }
}
