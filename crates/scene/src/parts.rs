//! Scenarios as read from files, before agents are selected, coordinates shifted and links resolved.

use reactsim_geometry::{Polygon, Vec2};

use super::{
    Crosswalk, LANE_HALF_WIDTH, LaneArea, LaneClass, LaneKind, Length, LightState, LoggedAgent, MapHeights,
    RoadEdge, RoadLine, StopKind, Surface,
};
use crate::{Certificate, Deviation, Frame};

/// A scenario as read by a format. [`super::Scenario::assemble`] checks it and converts it to the domain
/// type.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScenarioParts {
    /// Name of the scenario.
    pub id: String,
    /// Name of the data set or of the file's format, for provenance.
    pub source: String,
    /// World point of the origin. `None`: coordinates are world coordinates, and the AV's current position
    /// becomes the origin. `Some`: coordinates are already relative to this point.
    pub origin: Option<Vec2>,
    /// Number of frames of every track, light and list of times.
    pub length: Length,
    /// Time of each frame, seconds; empty if not recorded.
    pub timestamps: Vec<f64>,
    /// Index of the AV in `agents`.
    pub av: usize,
    /// Every recorded agent.
    pub agents: Vec<LoggedAgent>,
    /// Ids of the agents that the data set marks for prediction.
    pub tracks_to_predict: Vec<String>,
    /// Ids of the agents that the data set marks as interesting.
    pub objects_of_interest: Vec<String>,
    /// The map.
    pub map: MapParts,
    /// Lights.
    pub lights: Vec<LightParts>,
    /// A deviated AV that comes with the scenario.
    pub deviation: Option<DeviationParts>,
}

/// A map as read by a format; lanes are named by id.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapParts {
    /// Lanes in map order.
    pub lanes: Vec<LaneParts>,
    /// Oriented road edges.
    pub road_edges: Vec<RoadEdge>,
    /// Painted lines.
    pub road_lines: Vec<RoadLine>,
    /// Stop lines.
    pub stop_lines: Vec<StopLineParts>,
    /// Crosswalks.
    pub crosswalks: Vec<Crosswalk>,
    /// Speed bumps.
    pub speed_bumps: Vec<Surface>,
    /// Driveways.
    pub driveways: Vec<Surface>,
    /// Outlines of junctions.
    pub intersections: Vec<Vec<Vec2>>,
    /// Drivable polygons.
    pub drivable_area: Option<Vec<Polygon>>,
    /// Heights of the above; those of lanes are per point of [`LaneParts::points`]. Heights that are not
    /// finite are unknown.
    pub heights: MapHeights,
}

/// A lane as read by a format.
#[derive(Clone, Debug, PartialEq)]
pub struct LaneParts {
    /// Name.
    pub id: String,
    /// Lane between junctions, or connector.
    pub kind: LaneKind,
    /// Purpose.
    pub class: LaneClass,
    /// Speed limit, m/s.
    pub speed_limit: Option<f64>,
    /// Centre line in driving direction. A lane of fewer than two distinct points is removed and its links
    /// are joined.
    pub points: Vec<Vec2>,
    /// Ground covered by the lane.
    pub area: LaneArea,
    /// Ids of the lanes that begin where this one ends. Missing lanes are dropped and counted.
    pub successors: Vec<String>,
    /// Ids of the lanes that end where this one begins.
    pub predecessors: Vec<String>,
    /// Adjacent lanes on the left.
    pub left: Vec<NeighborParts>,
    /// Adjacent lanes on the right.
    pub right: Vec<NeighborParts>,
}

impl Default for LaneParts {
    /// A lane of a surface street without a name, points, a recorded width and links.
    fn default() -> Self {
        Self {
            id: String::new(),
            kind: LaneKind::Lane,
            class: LaneClass::SurfaceStreet,
            speed_limit: None,
            points: Vec::new(),
            area: LaneArea::Corridor { half_width: LANE_HALF_WIDTH },
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: Vec::new(),
            right: Vec::new(),
        }
    }
}

/// An adjacent lane, by id; point indices as in [`super::LaneNeighbor`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NeighborParts {
    /// Id of the other lane.
    pub lane: String,
    /// First point of this lane on the stretch.
    pub self_start: u32,
    /// Last point of this lane on the stretch.
    pub self_end: u32,
    /// First point of the neighbour on the stretch.
    pub other_start: u32,
    /// Last point of the neighbour on the stretch.
    pub other_end: u32,
}

impl NeighborParts {
    /// A neighbour along both lanes, which have these numbers of points.
    pub fn whole(lane: impl Into<String>, own_points: usize, other_points: usize) -> Self {
        let last = |points: usize| u32::try_from(points.saturating_sub(1)).unwrap_or(u32::MAX);
        Self {
            lane: lane.into(),
            self_start: 0,
            self_end: last(own_points),
            other_start: 0,
            other_end: last(other_points),
        }
    }
}

/// A stop line by lane id.
#[derive(Clone, Debug, PartialEq)]
pub struct StopLineParts {
    /// Reason for stopping.
    pub kind: StopKind,
    /// Id of the lane. Lines on missing lanes are dropped and counted.
    pub lane: String,
    /// A point on or near the line; it is projected onto the lane's baseline.
    pub at: Vec2,
}

/// A light by lane id.
#[derive(Clone, Debug, PartialEq)]
pub struct LightParts {
    /// Id of the controlled lane. Lights on missing lanes are dropped and counted.
    pub lane: String,
    /// Point at which to stop.
    pub stop_point: Vec2,
    /// One entry per frame (91); `None` if the light was not observed.
    pub states: Vec<Option<LightState>>,
}

impl LightParts {
    /// Returns the stop line of the controlled lane.
    pub fn stop_line(&self) -> StopLineParts {
        StopLineParts { kind: StopKind::Light, lane: self.lane.clone(), at: self.stop_point }
    }
}

/// A deviated AV trajectory for the steps 1 to 80.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviationParts {
    /// Dominant source of the deviation, if known.
    pub category: Option<Deviation>,
    /// 80 states.
    pub track: Vec<Frame>,
    /// Responses of the agents that the deviation affects, if known; in the same frame as `track`.
    pub certificate: Option<Certificate>,
}
