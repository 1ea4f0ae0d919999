//! Data model of a generated map: the road map as a format would read it, and the additional data that
//! traffic needs.

use reactsim_geometry::{Polyline, Vec2};
use reactsim_scene::{LightState, MapParts};

/// Generated map with its traffic rules.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    /// Lanes, edges, lines, stop lines, crosswalks and drivable area, in metres around (0, 0). Maps with
    /// roads above one another have heights of all of these; other maps have none.
    pub map: MapParts,
    /// Signal plans, one per controlled connector; all have the same cycle.
    pub signals: Vec<SignalPlan>,
    /// Right of way between lanes: where no light decides, and where lights let both go (permissive left
    /// turns).
    pub priorities: Vec<Priority>,
    /// Lanes on which vehicles enter the map, with their flows.
    pub entries: Vec<Entry>,
    /// Parking spots along the road and in car parks. On maps with heights they are at height 0, as are
    /// `yards`.
    pub parking: Vec<ParkingSpot>,
    /// Parking spots off the drivable ground: in front of homes, in car parks.
    pub yards: Vec<ParkingSpot>,
    /// Pavements, and the crossings that join them. Footways whose ends are within 3 m of each other are
    /// joined.
    pub footways: Vec<Footway>,
}

/// Signal plan of one lane.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalPlan {
    /// Id of the controlled lane (a connector, which begins at the stop line).
    pub lane: String,
    /// Point to stop at, metres.
    pub stop_point: Vec2,
    /// States with their durations in seconds, repeated from time 0 on.
    pub phases: Vec<(LightState, f64)>,
}

impl SignalPlan {
    /// Returns the state of the light at `time` seconds, or `None` for an empty cycle.
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

/// Obligation to yield. Vehicles on `lane` wait at its beginning, the stop line (on ramps and roundabouts,
/// the give-way line).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Priority {
    /// Id of the lane, usually a connector, on which vehicles yield.
    pub lane: String,
    /// Ids of the crossing or joining lanes on which vehicles have the right of way.
    pub to: Vec<String>,
    /// Manner of yielding.
    pub rule: RightOfWay,
}

/// Manner in which vehicles yield.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RightOfWay {
    /// Go when there is a gap.
    Yield,
    /// Stop, then go when there is a gap.
    Stop,
    /// Stop, then go in the order of arrival (all-way stop).
    AllWayStop,
}

/// Lane on which vehicles enter the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Id of the lane, which begins at the border of the map. Cyclists enter on bicycle lanes.
    pub lane: String,
    /// Vehicles per hour at density 1: what a busy lane of this kind carries without a growing queue.
    pub flow: f64,
}

/// Place for a parked vehicle.
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

/// Path for pedestrians in both directions.
#[derive(Clone, Debug)]
pub struct Footway {
    /// Centre line.
    pub line: Polyline,
    /// Height at each point of `line`, metres; empty on maps without heights.
    pub heights: Vec<f64>,
    /// Width, metres.
    pub width: f64,
    /// Whether it crosses a road (with a crosswalk of the map under it); its ends are then on other
    /// footways.
    pub crossing: bool,
    /// For crossings: ids of the crossed lanes, including connectors.
    pub crosses: Vec<String>,
    /// For crossings: ids of the controlled lanes for whose green or yellow people wait; empty where people
    /// have the right of way. Turning vehicles that have green at the same time as people yield to them.
    pub waits_for: Vec<String>,
}
