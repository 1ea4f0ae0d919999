//! Pieces of the lines of a map, each as eleven points.

use reactsim_geometry::{Bounds, Polyline, Vec2};
use reactsim_scene::{LaneClass, LaneKind, RoadEdgeKind, RoadMap, StopKind};

use super::rings::{closed, edge_rings};

/// Number of points of a piece.
pub const PIECE_POINTS: usize = 11;
/// Length of a piece, metres, where nothing else is asked; the last piece of a line is the remainder.
pub(crate) const PIECE_LENGTH: f64 = 5.0;
/// Length below which the remainder of a line is joined to the previous piece, metres.
const MIN_REMAINDER: f64 = 0.5;

/// Length above which a line counts as a fault of the map, metres.
pub const MAX_LINE_LENGTH: f64 = 1e5;

/// A piece of a line of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct MapPiece {
    /// Equidistant points including both ends, scenario frame. Lanes run in driving direction, edges
    /// with the road on their left.
    pub points: [Vec2; PIECE_POINTS],
    /// Kind of line that it is part of.
    pub kind: PieceKind,
    /// Lane that it is part of, or on which vehicles stop there: an index into `RoadMap::lanes`.
    pub lane: Option<usize>,
    /// Length, metres.
    pub length: f64,
    /// Speed limit of its lane, m/s, if known.
    pub speed_limit: Option<f64>,
}

/// Kind of a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PieceKind {
    /// A lane of a motorway.
    Freeway,
    /// Any other lane.
    Street,
    /// A lane for bicycles.
    BikeLane,
    /// A connector through a junction, in maps that distinguish these from lanes.
    Junction,
    /// The outer edge of the road.
    EdgeBoundary,
    /// The edge of a median or island.
    EdgeMedian,
    /// A stop line at a light.
    LightLine,
    /// A stop line at a stop sign.
    SignLine,
    /// A give-way line.
    YieldLine,
    /// The outline of a crosswalk.
    Crosswalk,
}

impl PieceKind {
    /// Number of kinds.
    pub const COUNT: usize = 10;

    /// Returns the code, starting at 0.
    pub const fn code(self) -> usize {
        self as usize
    }

    /// Returns whether vehicles or cyclists drive along it.
    pub const fn is_lane(self) -> bool {
        matches!(self, Self::Freeway | Self::Street | Self::BikeLane | Self::Junction)
    }
}

/// Returns the pieces, 5 m long, of a map with a point within `radius` metres of `about`, in the order of the
/// map: lanes, road edges (in maps without any, the edge of the drivable area), stop lines, crosswalks.
/// Painted lines are left out.
///
/// The positions of cuts do not depend on `about` and `radius`.
pub fn map_pieces(map: &RoadMap, about: Vec2, radius: f64) -> Vec<MapPiece> {
    map_pieces_of_length(map, about, radius, PIECE_LENGTH)
}

/// As [`map_pieces`], with pieces of this length, metres.
pub(crate) fn map_pieces_of_length(map: &RoadMap, about: Vec2, radius: f64, length: f64) -> Vec<MapPiece> {
    let mut cutter = Cutter { about, radius, piece: length, pieces: Vec::new() };
    let distinguishes_connectors = map.lanes.iter().any(|l| l.kind == LaneKind::Lane);
    for (i, lane) in map.lanes.iter().enumerate() {
        let kind = match (lane.kind, lane.class) {
            (_, LaneClass::Bike) => PieceKind::BikeLane,
            (LaneKind::Connector, _) if distinguishes_connectors => PieceKind::Junction,
            (_, LaneClass::Freeway) => PieceKind::Freeway,
            _ => PieceKind::Street,
        };
        cutter.cut(&lane.baseline, kind, Some(i), lane.speed_limit);
    }
    for edge in &map.road_edges {
        let kind =
            if edge.kind == RoadEdgeKind::Median { PieceKind::EdgeMedian } else { PieceKind::EdgeBoundary };
        cutter.cut_points(&edge.points, kind, None);
    }
    if map.road_edges.is_empty() {
        for (ring, is_hole) in edge_rings(map) {
            let kind = if is_hole { PieceKind::EdgeMedian } else { PieceKind::EdgeBoundary };
            cutter.cut_points(&ring, kind, None);
        }
    }
    for line in &map.stop_lines {
        let kind = match line.kind {
            StopKind::Light => PieceKind::LightLine,
            StopKind::Sign => PieceKind::SignLine,
            StopKind::Yield => PieceKind::YieldLine,
        };
        cutter.cut_points(&line.ends, kind, Some(line.lane));
    }
    for crosswalk in &map.crosswalks {
        cutter.cut_points(&closed(&crosswalk.outline), PieceKind::Crosswalk, None);
    }
    cutter.pieces
}

/// Cutter of lines near a point.
struct Cutter {
    about: Vec2,
    radius: f64,
    /// Length of a piece.
    piece: f64,
    pieces: Vec<MapPiece>,
}

impl Cutter {
    fn cut_points(&mut self, points: &[Vec2], kind: PieceKind, lane: Option<usize>) {
        if let Ok(line) = Polyline::new(points) {
            self.cut(&line, kind, lane, None);
        }
    }

    fn cut(&mut self, line: &Polyline, kind: PieceKind, lane: Option<usize>, speed_limit: Option<f64>) {
        let near = Bounds::around(self.about, self.radius);
        let bounds = Bounds::of(line.points().iter().copied());
        if !bounds.intersects(&near) || !(line.length() <= MAX_LINE_LENGTH) {
            return;
        }
        let length = line.length();
        let (mut from, mut segment) = (0.0, 0);
        while from < length {
            let to = if length - from < self.piece + MIN_REMAINDER { length } else { from + self.piece };
            let points = std::array::from_fn(|i| {
                let s = from + (to - from) * i as f64 / (PIECE_POINTS - 1) as f64;
                segment = line.segment_from(s, segment);
                line.on_segment(s, segment)
            });
            let reach = self.radius * self.radius;
            if points.iter().any(|p| (p - self.about).norm_squared() <= reach) {
                self.pieces.push(MapPiece { points, kind, lane, length: to - from, speed_limit });
            }
            from = to;
        }
    }
}
