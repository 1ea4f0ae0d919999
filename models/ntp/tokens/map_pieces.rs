//! The map as our own network sees it: pieces of lines, each as eleven points.

use reactsim::geometry::{Bounds, Polygon, Polyline, Vec2, ring_area, union_of};
use reactsim::scene::{LaneClass, LaneKind, RoadEdgeKind, RoadMap, StopKind};

/// Points of a piece.
pub const PIECE_POINTS: usize = 11;
/// Length of a piece, metres; the last one of a line is what is left.
const PIECE: f64 = 5.0;
/// What is left is joined to the piece before if it is shorter than this, metres.
const SHORT: f64 = 0.5;

/// Lines that are longer are faults of the map, metres.
pub(super) const LONGEST: f64 = 1e5;

/// A piece of a line of the map, at most 5.5 m long.
#[derive(Clone, Debug, PartialEq)]
pub struct MapPiece {
    /// Points at equal distances along it, both ends included; scenario frame. Lanes run in driving direction, edges with the road on their left.
    pub points: [Vec2; PIECE_POINTS],
    /// What it is part of.
    pub kind: PieceKind,
    /// The lane that it is part of, or whose vehicles stop there: an index into `RoadMap::lanes`.
    pub lane: Option<usize>,
    /// Its length, metres.
    pub length: f64,
    /// Speed limit of its lane, m/s, where known.
    pub speed_limit: Option<f64>,
}

/// What a piece is part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PieceKind {
    /// A lane of a motorway.
    Freeway,
    /// Another lane.
    Street,
    /// A lane for bicycles.
    BikeLane,
    /// A path through a junction, in maps that tell these from lanes.
    Junction,
    /// The outer edge of the road.
    EdgeBoundary,
    /// The edge of a median or island.
    EdgeMedian,
    /// Where a light makes vehicles stop.
    LightLine,
    /// Where a stop sign makes vehicles stop.
    SignLine,
    /// Where vehicles give way.
    YieldLine,
    /// The outline of a crosswalk.
    Crosswalk,
}

impl PieceKind {
    /// Number of kinds.
    pub const COUNT: usize = 10;

    /// The code, from 0 on.
    pub const fn code(self) -> usize {
        self as usize
    }

    /// Whether vehicles or bicycles drive along it.
    pub const fn is_lane(self) -> bool {
        matches!(self, Self::Freeway | Self::Street | Self::BikeLane | Self::Junction)
    }
}

/// The pieces of a map of which a point lies within `radius` metres of `about`, in the order of the map: lanes, road edges (in maps
/// without any the edge of the drivable area), stop lines, crosswalks. Painted lines are left out.
///
/// Where a line is cut does not depend on the point and the radius.
pub fn map_pieces(map: &RoadMap, about: Vec2, radius: f64) -> Vec<MapPiece> {
    let mut cutter = Cutter { about, radius, pieces: Vec::new() };
    let tells_junctions = map.lanes.iter().any(|l| l.kind == LaneKind::Lane);
    for (i, lane) in map.lanes.iter().enumerate() {
        let kind = match (lane.kind, lane.class) {
            (_, LaneClass::Bike) => PieceKind::BikeLane,
            (LaneKind::Connector, _) if tells_junctions => PieceKind::Junction,
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

/// The rings around the drivable area, closed, with the area on their left, and whether they cut something out of it. Where its polygons
/// overlap or touch there is none.
pub(crate) fn edge_rings(map: &RoadMap) -> Vec<(Vec<Vec2>, bool)> {
    let area = map.drivable_area.as_deref().unwrap_or_default();
    let merged = union_of(area).unwrap_or_else(|| area.to_vec());
    let rings = |p: &Polygon| {
        let holes = p.holes.iter().map(|hole| (oriented(hole, false), true));
        std::iter::once((oriented(&p.exterior, true), false)).chain(holes).collect::<Vec<_>>()
    };
    merged.iter().flat_map(rings).collect()
}

/// A ring that ends where it begins.
pub(crate) fn closed(ring: &[Vec2]) -> Vec<Vec2> {
    let mut ring = ring.to_vec();
    if let Some(&first) = ring.first()
        && ring.last() != Some(&first)
    {
        ring.push(first);
    }
    ring
}

/// A closed ring that runs counter-clockwise, or clockwise.
fn oriented(ring: &[Vec2], counter_clockwise: bool) -> Vec<Vec2> {
    let mut ring = closed(ring);
    if (ring_area(&ring) > 0.0) != counter_clockwise {
        ring.reverse();
    }
    ring
}

/// Cuts lines near a point.
struct Cutter {
    about: Vec2,
    radius: f64,
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
        if !bounds.intersects(&near) || !(line.length() <= LONGEST) {
            return;
        }
        let length = line.length();
        let (mut from, mut segment) = (0.0, 0);
        while from < length {
            let to = if length - from < PIECE + SHORT { length } else { from + PIECE };
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
