//! What a generated map is: the road map as a format would read it, and what traffic must know beside it.

use crate::geometry::{Polyline, Vec2};
use crate::scene::{LightState, MapParts};

/// A generated map with its rules of traffic.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    /// Id of the map type, such as `signalised-junction`.
    pub kind: String,
    /// Lanes, edges, lines, stop lines, crosswalks, drivable area, in metres around (0, 0).
    pub map: MapParts,
    /// Lights: one plan per controlled connector; all have the same cycle.
    pub signals: Vec<SignalPlan>,
    /// Who gives way to whom: where no light decides, and where it lets both go (permissive left turns).
    pub priorities: Vec<Priority>,
    /// Lanes on which vehicles come into the map, with how much traffic each takes.
    pub entries: Vec<Entry>,
    /// Where vehicles may stand parked.
    pub parking: Vec<ParkingSpot>,
    /// Where vehicles stand off the ground that others drive on: before homes, in car parks.
    pub yards: Vec<ParkingSpot>,
    /// Where people walk: pavements, and crossings that join them. Footways whose ends lie within 3 m of each other are joined.
    pub footways: Vec<Footway>,
}

/// The light of one lane.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalPlan {
    /// Id of the controlled lane (a connector, which begins at the stop line).
    pub lane: String,
    /// Where to stop, metres.
    pub stop_point: Vec2,
    /// What it shows, one after the other, from time 0 on and then again: state and seconds.
    pub phases: Vec<(LightState, f64)>,
}

impl SignalPlan {
    /// What the light shows after so many seconds.
    pub fn at(&self, time: f64) -> Option<LightState> {
        let cycle: f64 = self.phases.iter().map(|p| p.1).sum();
        let mut left = if cycle > 0.0 { time.rem_euclid(cycle) } else { return None };
        for &(state, seconds) in &self.phases {
            if left < seconds {
                return Some(state);
            }
            left -= seconds;
        }
        self.phases.last().map(|p| p.0)
    }
}

/// Who must give way. Vehicles on `lane` wait at its beginning, the stop line (on ramps and roundabouts: the give-way line).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Priority {
    /// Id of the lane, mostly a connector, on which vehicles give way.
    pub lane: String,
    /// Ids of the lanes that cross it or join it on which vehicles go first.
    pub to: Vec<String>,
    /// How.
    pub rule: RightOfWay,
}

/// How vehicles give way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RightOfWay {
    /// Go when there is a gap.
    Yield,
    /// Stop, then go when there is a gap.
    Stop,
    /// Stop, then go in the order of arrival (all-way stop).
    AllWayStop,
}

/// A lane on which vehicles come into the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Id of the lane; it begins at the border of the map. Bicycle lanes are entered by cyclists.
    pub lane: String,
    /// Vehicles per hour at density 1: what a busy lane of this kind carries without a queue that grows.
    pub flow: f64,
}

/// A place for a parked vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParkingSpot {
    /// Centre, metres.
    pub position: Vec2,
    /// Heading, radians.
    pub heading: f64,
    /// Longest vehicle that fits, metres.
    pub length: f64,
    /// Widest vehicle that fits, metres.
    pub width: f64,
}

/// A stretch on which people walk, both ways.
#[derive(Clone, Debug)]
pub struct Footway {
    /// Its middle.
    pub line: Polyline,
    /// Its width, metres.
    pub width: f64,
    /// Whether it crosses a road (a crosswalk of the map lies under it): then it begins and ends on other footways.
    pub crossing: bool,
    /// For crossings: ids of the lanes that it crosses, connectors among them.
    pub crosses: Vec<String>,
    /// For crossings: ids of the controlled lanes whose green or yellow means that people wait; empty where they have priority. Turning
    /// vehicles that have green at the same time as people give way to them.
    pub waits_for: Vec<String>,
}
