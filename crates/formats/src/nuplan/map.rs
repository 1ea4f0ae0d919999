//! Content of a nuPlan map, in metres of its UTM zone.

use std::collections::BTreeMap;

use reactsim_geometry::{Bounds, Polygon, Vec2};

#[derive(Debug, Default)]
pub(super) struct Map {
    /// EPSG code of the coordinates.
    pub(super) epsg: i64,
    /// Lanes and lane connectors by fid, which is unique among both.
    pub(super) lanes: BTreeMap<i64, MapLane>,
    /// Boundaries of lanes by fid.
    pub(super) boundaries: BTreeMap<i64, Boundary>,
    /// Stop polygons by fid.
    pub(super) stops: BTreeMap<i64, Stop>,
    pub(super) crosswalks: Vec<Area>,
    /// Junctions.
    pub(super) intersections: Vec<Area>,
    /// Drivable area: road segments, junctions, generic drivable areas and car parks.
    pub(super) drivable: Vec<Area>,
}

/// A lane or a lane connector.
#[derive(Debug, Default)]
pub(super) struct MapLane {
    pub(super) is_connector: bool,
    /// Group of parallel lanes (roadblock or roadblock connector).
    pub(super) roadblock: Option<i64>,
    /// Index in the group, from 0 on the left; `None` for connectors.
    pub(super) index: Option<i64>,
    /// Type of the lane: 0 vehicles, 1 bicycles.
    pub(super) lane_type: Option<i64>,
    /// Speed limit, m/s; NaN if there is none.
    pub(super) speed_limit: f64,
    /// Centre line in driving direction; empty if the map has none.
    pub(super) baseline: Vec<Vec2>,
    /// Outline; empty if the map has none. A few outlines have holes.
    pub(super) outline: Polygon,
    /// Fids of the boundary lines, left and right.
    pub(super) sides: [Option<i64>; 2],
    /// Predecessors, in ascending order; for connectors the preceding lane.
    pub(super) incoming: Vec<i64>,
    /// Successors, in ascending order; for connectors the following lane.
    pub(super) outgoing: Vec<i64>,
    /// Neighbours, left and right.
    pub(super) neighbors: [Option<i64>; 2],
    /// Fids of the stop polygons listed for the traffic lights of a connector.
    pub(super) stop_fids: Vec<i64>,
    /// Bounding box of the centre line and the outline.
    pub(super) bounds: Bounds,
}

/// Boundary line of lanes.
#[derive(Debug)]
pub(super) struct Boundary {
    /// Type: 0 dashed, 2 solid; others are not painted.
    pub(super) kind: Option<i64>,
    /// Points, not necessarily in driving direction.
    pub(super) points: Vec<Vec2>,
    pub(super) bounds: Bounds,
}

/// A stop polygon.
#[derive(Debug)]
pub(super) struct Stop {
    /// Type: 0 crosswalk, 1 stop sign, 2 traffic light, 3 turn stop, 4 yield, 5 unknown.
    pub(super) kind: Option<i64>,
    pub(super) polygons: Vec<Polygon>,
    /// Fids of the connectors that stop here, or of the lanes if no connectors are listed.
    pub(super) lanes: Vec<i64>,
}

/// A named area.
#[derive(Clone, Debug)]
pub(super) struct Area {
    /// Fid in its layer.
    pub(super) fid: i64,
    pub(super) polygons: Vec<Polygon>,
    pub(super) bounds: Bounds,
}

impl Map {
    /// Returns the stop polygons of a connector as selected by the devkit: the listed ones that touch its
    /// centre line, or if none does, the one nearest to its start.
    pub(super) fn stop_lines(&self, lane: &MapLane) -> Vec<i64> {
        let listed: Vec<(i64, &Stop)> =
            lane.stop_fids.iter().filter_map(|fid| Some((*fid, self.stops.get(fid)?))).collect();
        let touching: Vec<i64> =
            listed.iter().filter(|(_, stop)| stop.touches(&lane.baseline)).map(|(fid, _)| *fid).collect();
        let Some(&first) = lane.baseline.first().filter(|_| touching.is_empty()) else { return touching };
        let nearest = listed.iter().min_by(|a, b| a.1.distance(first).total_cmp(&b.1.distance(first)));
        nearest.map(|(fid, _)| *fid).into_iter().collect()
    }
}

impl Stop {
    fn distance(&self, p: Vec2) -> f64 {
        let of = |polygon: &Polygon| {
            if polygon.contains(p) { 0.0 } else { reactsim_geometry::ring_distance(p, &polygon.exterior) }
        };
        self.polygons.iter().map(of).fold(f64::INFINITY, f64::min)
    }

    fn touches(&self, line: &[Vec2]) -> bool {
        self.polygons.iter().any(|polygon| {
            let (ring, bounds) = (&polygon.exterior, polygon.bounds());
            let near = |w: &[Vec2]| Bounds::of([w[0], w[1]]).intersects(&bounds);
            let crosses =
                |w: &[Vec2]| near(w) && ring.windows(2).any(|e| segments_meet(w[0], w[1], e[0], e[1]));
            line.iter().any(|p| bounds.contains(*p) && polygon.contains(*p)) || line.windows(2).any(crosses)
        })
    }

    /// Returns the mean of the corners: a point on or near the stop line.
    pub(super) fn middle(&self) -> Option<Vec2> {
        let ring = &self.polygons.first()?.exterior;
        let corners = ring.get(1..).filter(|c| !c.is_empty())?;
        Some(corners.iter().sum::<Vec2>() / corners.len() as f64)
    }
}

/// Returns whether two segments have a point in common.
fn segments_meet(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> bool {
    let side = |p: Vec2, q: Vec2, r: Vec2| (q - p).perp(&(r - p));
    let (c_side, d_side) = (side(a, b, c), side(a, b, d));
    let (a_side, b_side) = (side(c, d, a), side(c, d, b));
    if c_side * d_side < 0.0 && a_side * b_side < 0.0 {
        return true;
    }
    let on = |p: Vec2, q: Vec2, r: Vec2, s: f64| {
        s == 0.0 && r.x >= p.x.min(q.x) && r.x <= p.x.max(q.x) && r.y >= p.y.min(q.y) && r.y <= p.y.max(q.y)
    };
    on(a, b, c, c_side) || on(a, b, d, d_side) || on(c, d, a, a_side) || on(c, d, b, b_side)
}
