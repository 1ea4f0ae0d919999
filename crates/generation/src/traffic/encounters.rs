//! Pedestrians and vehicles at crossings, and what each perceives of the other.

use super::network::Network;
use super::people::{Approach, Crosser, Crowd, Surroundings, Vehicle as CrossingVehicle, WalkLight};
use super::vehicle::Vehicle;
use crate::Layout;

/// Distance from a crossing, metres, beyond which vehicles do not matter to pedestrians.
const APPROACH_RANGE: f64 = 60.0;

/// The crowd, and the places where vehicle lanes cross its footways.
pub(super) struct Encounters {
    pub(super) crowd: Crowd,
    /// Per footway of the layout: its index among the crowd's crossings.
    crossing_indices: Vec<Option<usize>>,
    /// Per lane and crossing on it: arc length along the footway at which the lane crosses it.
    places: Vec<Vec<f64>>,
    vehicles: Vec<CrossingVehicle>,
    approaches: Vec<Approach>,
    lights: Vec<WalkLight>,
}

impl Encounters {
    pub(super) fn new(layout: &Layout, network: &Network, crowd: Crowd) -> Self {
        let mut crossing_indices = vec![None; layout.footways.len()];
        for (i, crossing) in crowd.crossings().iter().enumerate() {
            crossing_indices[crossing.footway] = Some(i);
        }
        let place = |lane: &super::network::TrafficLane, &(f, [from, to]): &(usize, [f64; 2])| {
            layout.footways[f].line.project(lane.line.at(0.5 * (from + to))).s
        };
        let places =
            network.lanes.iter().map(|l| l.crossings.iter().map(|c| place(l, c)).collect()).collect();
        Self {
            crowd,
            crossing_indices,
            places,
            vehicles: Vec::new(),
            approaches: Vec::new(),
            lights: Vec::new(),
        }
    }

    /// Moves all pedestrians by `dt` seconds.
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
            // New pedestrians may still arrive; they look at the traffic then.
            self.crowd.step(dt, &Surroundings::default());
            return;
        }
        for v in vehicles {
            let mut start = 0.0;
            let mut near = false;
            for &index in &v.path {
                if start - v.front() > APPROACH_RANGE {
                    break;
                }
                for (k, &(footway, [from, to])) in network.lanes[index].crossings.iter().enumerate() {
                    let distance = start + from - v.front();
                    let passed = start + to < v.s - 0.5 * v.body.length;
                    let Some(crossing) = self.crossing_indices[footway] else { continue };
                    if distance > APPROACH_RANGE || passed {
                        continue;
                    }
                    near |= distance < 15.0;
                    self.approaches.push(Approach {
                        crossing,
                        at: self.places[index][k],
                        distance,
                        speed: v.speed,
                        acceleration: v.acceleration,
                        length: v.body.length,
                        width: v.body.width,
                    });
                }
                start += network.lanes[index].length;
            }
            if near {
                let pose = v.pose();
                self.vehicles.push(CrossingVehicle {
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

    /// Returns the people who are on the crossing of a footway or about to step on it.
    pub(super) fn people_on(&self, footway: usize) -> &[Crosser] {
        self.crossing_indices[footway].map_or(&[], |i| &self.crowd.crossings()[i].people)
    }
}
