//! The road map: lanes with their graph, edges, lines, stop lines, crosswalks, drivable area.

use reactsim_geometry::{Polygon, Polyline, Vec2};

use super::{MapHeights, named_enum};

/// A lane of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Lane {
    /// Name, unique in the map.
    pub id: String,
    /// Lane between junctions, or connector inside a junction.
    pub kind: LaneKind,
    /// Purpose of the lane.
    pub class: LaneClass,
    /// Speed limit, m/s, if known.
    pub speed_limit: Option<f64>,
    /// Centre line in driving direction.
    pub baseline: Polyline,
    /// Ground covered by the lane.
    pub area: LaneArea,
    /// Lanes that begin where this one ends (indices into `RoadMap::lanes`).
    pub successors: Vec<usize>,
    /// Lanes that end where this one begins.
    pub predecessors: Vec<usize>,
    /// Adjacent lanes on the left with the same direction.
    pub left: Vec<LaneNeighbor>,
    /// Adjacent lanes on the right with the same direction.
    pub right: Vec<LaneNeighbor>,
}

named_enum! {
    name, from_name;

    /// Position of a lane relative to junctions.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum LaneKind {
        /// A lane between junctions; lanes do not overlap one another.
        Lane = "lane",
        /// A lane through a junction; connectors overlap. In maps with overlapping lanes (Waymo) every lane
        /// is a connector.
        Connector = "connector",
    }
}

named_enum! {
    name, from_name;

    /// The purpose of a lane, in the order of the codes 0 to 3.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum LaneClass {
        /// Not recorded.
        Undefined = "undefined",
        /// Motorway.
        Freeway = "freeway",
        /// Other road.
        SurfaceStreet = "surface_street",
        /// Bicycles only.
        Bike = "bike",
    }
}

/// Half-width of a lane whose width is not recorded, metres.
pub const LANE_HALF_WIDTH: f64 = 1.75;

/// The ground covered by a lane.
#[derive(Clone, Debug, PartialEq)]
pub enum LaneArea {
    /// A ring, open or closed.
    Polygon(Vec<Vec2>),
    /// The baseline buffered by `half_width` metres with flat ends and round joins (maps that record no lane
    /// outline).
    Corridor {
        /// Half-width, metres.
        half_width: f64,
    },
}

/// A stretch along which another lane is adjacent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LaneNeighbor {
    /// Index of the other lane.
    pub lane: usize,
    /// First point of this lane's recorded baseline on the stretch.
    pub self_start: u32,
    /// Last point of this lane's recorded baseline on the stretch.
    pub self_end: u32,
    /// First point of the neighbour's recorded baseline on the stretch.
    pub other_start: u32,
    /// Last point of the neighbour's recorded baseline on the stretch.
    pub other_end: u32,
}

/// The edge of the road; the drivable side is on the left.
#[derive(Clone, Debug, PartialEq)]
pub struct RoadEdge {
    /// Boundary or median.
    pub kind: RoadEdgeKind,
    /// Oriented points.
    pub points: Vec<Vec2>,
}

named_enum! {
    name, from_name;

    /// The area that a road edge bounds, in the order of the codes 0 to 2.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum RoadEdgeKind {
        /// Not recorded.
        Unknown = "unknown",
        /// Outer boundary.
        Boundary = "boundary",
        /// Median or island.
        Median = "median",
    }
}

/// A painted line.
#[derive(Clone, Debug, PartialEq)]
pub struct RoadLine {
    /// Paint, as the codes 0 to 8 of the Waymo messages (0 unknown, 1 broken single white, … 8 passing double
    /// yellow).
    pub paint: u8,
    /// Points.
    pub points: Vec<Vec2>,
}

/// A stop line across one lane.
#[derive(Clone, Debug, PartialEq)]
pub struct StopLine {
    /// Reason for stopping.
    pub kind: StopKind,
    /// Index of the lane.
    pub lane: usize,
    /// Arc length along the lane's baseline, metres.
    pub s: f64,
    /// The two ends of the line across the lane.
    pub ends: [Vec2; 2],
}

named_enum! {
    name, from_name;

    /// The reason for stopping at a stop line.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum StopKind {
        /// A traffic light: stop on red and yellow.
        Light = "light",
        /// A stop sign: stop, then go when clear.
        Sign = "sign",
        /// A give-way line: go when clear.
        Yield = "yield",
    }
}

/// A pedestrian crossing.
#[derive(Clone, Debug, PartialEq)]
pub struct Crosswalk {
    /// Outline, open or closed.
    pub outline: Vec<Vec2>,
}

/// Another marked surface: a speed bump or a driveway.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Outline, open or closed.
    pub outline: Vec<Vec2>,
}

/// The static map.
///
/// The drivable area is given by polygons **or**, if there are none, by the left side of the road edges. The
/// order of the lanes matters: if several contain a point, the first one counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoadMap {
    /// Lanes; links are indices into this list.
    pub lanes: Vec<Lane>,
    /// Oriented road edges.
    pub road_edges: Vec<RoadEdge>,
    /// Painted lines.
    pub road_lines: Vec<RoadLine>,
    /// Stop lines.
    pub stop_lines: Vec<StopLine>,
    /// Crosswalks.
    pub crosswalks: Vec<Crosswalk>,
    /// Speed bumps.
    pub speed_bumps: Vec<Surface>,
    /// Driveways.
    pub driveways: Vec<Surface>,
    /// Outlines of junctions.
    pub intersections: Vec<Vec<Vec2>>,
    /// Drivable polygons (union, strict interior); `None` if the map has none.
    pub drivable_area: Option<Vec<Polygon>>,
    /// Heights of the above; empty if the map has one level.
    pub heights: MapHeights,
}
