//! The spatial index of a map, built once per scenario, and its queries.

use std::sync::OnceLock;

use reactsim_geometry::{
    Bounds, Grid, NearestEdge, OrientedEdges, PolygonIndex, Projection, RingIndex, Vec2, point_in_ring,
    point_segment, ring_distance,
};

use super::levels::Ground;
use super::{Lane, LaneArea, RoadMap};

/// A lane found at or near a point, with the projection of the point onto its baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaneHit {
    /// Index of the lane.
    pub lane: usize,
    /// Projection onto the baseline.
    pub projection: Projection,
}

/// Spatial indices of lanes, edges and areas.
#[derive(Clone, Debug)]
pub struct MapIndex {
    pieces: Vec<Piece>,
    piece_bounds: Vec<Bounds>,
    /// For each lane, its first piece; then the number of pieces.
    first_pieces: Vec<usize>,
    piece_grid: Grid,
    polygon_lanes: Vec<usize>,
    polygon_grid: Grid,
    /// For each lane, its polygon; made at the first point near it.
    lane_rings: Vec<OnceLock<RingIndex>>,
    edges: OrientedEdges,
    area_grid: Grid,
    areas: Vec<PolygonIndex>,
    intersection_grid: Grid,
    driveway_grid: Grid,
    /// Heights of the ends of each segment of `edges`, metres; empty if the map has one level.
    edge_heights: Vec<[f64; 2]>,
    ground: Ground,
}

/// Successive segments of a lane's baseline.
#[derive(Clone, Copy, Debug)]
struct Piece {
    lane: u32,
    first: u32,
    last: u32,
}

/// Number of segments per piece: about 4 m of a Waymo lane.
const PIECE_SEGMENTS: usize = 8;
/// Cell size of the grids, metres.
const CELL_SIZE: f64 = 6.0;
/// Squared distance, m², which is more than the error of bounds.
const BOUNDS_ERROR2: f64 = 1e-12;

impl MapIndex {
    /// Builds the index.
    pub fn new(map: &RoadMap) -> Self {
        let (mut pieces, mut bounds, mut first_pieces) = (Vec::new(), Vec::new(), vec![0]);
        let (mut polygon_lanes, mut polygon_bounds) = (Vec::new(), Vec::new());
        for (i, lane) in map.lanes.iter().enumerate() {
            let reach = match &lane.area {
                LaneArea::Corridor { half_width } => *half_width,
                LaneArea::Polygon(ring) => {
                    polygon_lanes.push(i);
                    polygon_bounds.push(Bounds::of(ring.iter().copied()));
                    0.0
                }
            };
            let mut first = 0;
            while first < lane.baseline.segments() {
                let last = (first + PIECE_SEGMENTS).min(lane.baseline.segments());
                pieces.push(Piece { lane: i as u32, first: first as u32, last: last as u32 });
                bounds.push(Bounds::of(lane.baseline.points()[first..=last].iter().copied()).inflated(reach));
                first = last;
            }
            first_pieces.push(pieces.len());
        }
        let area = map.drivable_area.iter().flatten();
        let intersections = map.intersections.iter();
        let driveways = map.driveways.iter();
        Self {
            piece_grid: Grid::new(&bounds, CELL_SIZE),
            pieces,
            piece_bounds: bounds,
            first_pieces,
            lane_rings: vec![OnceLock::new(); map.lanes.len()],
            polygon_lanes,
            polygon_grid: Grid::new(&polygon_bounds, CELL_SIZE),
            edge_heights: edge_heights(map),
            ground: Ground::new(map),
            edges: OrientedEdges::new(map.road_edges.iter().map(|e| e.points.as_slice())),
            areas: area.clone().map(PolygonIndex::new).collect(),
            area_grid: Grid::new(&area.map(|p| p.bounds()).collect::<Vec<_>>(), CELL_SIZE),
            intersection_grid: Grid::new(
                &intersections.map(|r| Bounds::of(r.iter().copied())).collect::<Vec<_>>(),
                CELL_SIZE,
            ),
            driveway_grid: Grid::new(
                &driveways.map(|d| Bounds::of(d.outline.iter().copied())).collect::<Vec<_>>(),
                CELL_SIZE,
            ),
        }
    }
}

/// Returns the heights of the segments of all road edges, as [`OrientedEdges`] numbers them; NaN if unknown.
fn edge_heights(map: &RoadMap) -> Vec<[f64; 2]> {
    if map.heights.is_empty() {
        return Vec::new();
    }
    let none = Vec::new();
    let mut all = Vec::new();
    for (i, edge) in map.road_edges.iter().enumerate() {
        let heights = map.heights.road_edges.get(i).unwrap_or(&none);
        let height = |k: usize| heights.get(k).copied().unwrap_or(f64::NAN);
        let pairs = edge.points.windows(2).enumerate().filter(|(_, pair)| pair[0] != pair[1]);
        all.extend(pairs.map(|(k, _)| [height(k), height(k + 1)]));
    }
    all
}

/// A map with its spatial index, which answers all map queries.
#[derive(Clone, Copy, Debug)]
pub struct Road<'a> {
    /// The map.
    pub map: &'a RoadMap,
    index: &'a MapIndex,
    /// Point and height whose level answers the queries, metres; a NaN height for all levels.
    pub(super) level: (Vec2, f64),
}

impl<'a> Road<'a> {
    /// Joins a map with the index that was built from it.
    pub fn new(map: &'a RoadMap, index: &'a MapIndex) -> Self {
        Self { map, index, level: (Vec2::zeros(), f64::NAN) }
    }

    /// Returns the road on the level of a point at `height`, metres: its queries leave out what is on another
    /// level. A NaN height is on every level.
    pub fn on_level(self, p: Vec2, height: f64) -> Self {
        if height.is_nan() || !self.map.heights.is_empty() {
            Self { level: (p, height), ..self }
        } else {
            self
        }
    }

    /// Returns whether the point of a lane nearest to `p` is on another level than the road.
    fn is_above_or_below(&self, p: Vec2, lane: usize, at: &Projection) -> bool {
        !self.has_all_levels() && self.is_off_level(p, self.map.heights.of_lane(lane, at), at.distance)
    }

    /// Returns whether queries find what is on any level.
    fn has_all_levels(&self) -> bool {
        self.level.1.is_nan()
    }

    pub(super) fn ground(&self) -> &'a Ground {
        &self.index.ground
    }

    /// Returns the lane with this index.
    pub fn lane(&self, lane: usize) -> &'a Lane {
        &self.map.lanes[lane]
    }

    /// Finds the lanes whose area strictly contains `p`, in map order, and writes them to `hits` (cleared
    /// first).
    pub fn lanes_at(&self, p: Vec2, hits: &mut Vec<LaneHit>) {
        hits.clear();
        let cell = self.index.piece_grid.at(p);
        let mut k = 0;
        while k < cell.len() {
            let lane = self.index.pieces[cell[k] as usize].lane;
            let end = cell[k..].partition_point(|&i| self.index.pieces[i as usize].lane == lane) + k;
            if let LaneArea::Corridor { half_width } = self.map.lanes[lane as usize].area
                && let Some(projection) = self.in_corridor(p, lane as usize, half_width, &cell[k..end])
                && !self.is_above_or_below(p, lane as usize, &projection)
            {
                hits.push(LaneHit { lane: lane as usize, projection });
            }
            k = end;
        }
        let polygons = self.index.polygon_grid.at(p);
        if polygons.is_empty() {
            return;
        }
        for &i in polygons {
            let lane = self.index.polygon_lanes[i as usize];
            if let LaneArea::Polygon(ring) = &self.map.lanes[lane].area
                && self.is_in_lane(p, lane, ring)
            {
                let projection = self.project_on(p, lane);
                if !self.is_above_or_below(p, lane, &projection) {
                    hits.push(LaneHit { lane, projection });
                }
            }
        }
        hits.sort_by_key(|h| h.lane);
    }

    /// Returns the projection of `p` onto the baseline of one lane if its area strictly contains `p`. The
    /// result equals that of [`Road::lanes_at`] for this lane.
    pub fn lane_at(&self, p: Vec2, lane: usize) -> Option<Projection> {
        let found = match &self.map.lanes[lane].area {
            LaneArea::Corridor { half_width } => {
                let cell = self.index.piece_grid.at(p);
                let of = |i: &u32| self.index.pieces[*i as usize].lane as usize;
                let start = cell.partition_point(|i| of(i) < lane);
                let end = start + cell[start..].partition_point(|i| of(i) == lane);
                self.in_corridor(p, lane, *half_width, &cell[start..end])
            }
            LaneArea::Polygon(ring) => self.is_in_lane(p, lane, ring).then(|| self.project_on(p, lane)),
        };
        found.filter(|projection| !self.is_above_or_below(p, lane, projection))
    }

    /// Returns whether the polygon of a lane strictly contains `p`.
    fn is_in_lane(&self, p: Vec2, lane: usize, ring: &[Vec2]) -> bool {
        let index = self.index.lane_rings[lane].get_or_init(|| RingIndex::new(ring));
        index.locate(p) == Some(true)
    }

    /// Projects `p` onto the nearest point of the baseline of a lane, as [`Polyline::project`] does, but
    /// examines only pieces of the baseline near that point.
    ///
    /// [`Polyline::project`]: reactsim_geometry::Polyline::project
    fn project_on(&self, p: Vec2, lane: usize) -> Projection {
        let line = &self.map.lanes[lane].baseline;
        let pieces = self.index.first_pieces[lane]..self.index.first_pieces[lane + 1];
        let distance2 = |piece: usize| self.index.piece_bounds[piece].distance2(p);
        let (mut closest, mut start) = (f64::INFINITY, pieces.start);
        for piece in pieces.clone() {
            let found = distance2(piece);
            if found < closest {
                (closest, start) = (found, piece);
            }
        }
        let mut nearest = (f64::INFINITY, 0_usize);
        for piece in std::iter::once(start).chain(pieces.filter(|&piece| piece != start)) {
            // The slack is larger than the error of the distances.
            if distance2(piece) > nearest.0 * (1.0 + 1e-9) + 1e-9 {
                continue;
            }
            let Piece { first, last, .. } = self.index.pieces[piece];
            for i in first as usize..last as usize {
                let (a, b) = line.segment(i);
                let (d2, _) = point_segment(p, a, b);
                if d2 < nearest.0 || (d2 == nearest.0 && i < nearest.1) {
                    nearest = (d2, i);
                }
            }
        }
        line.project_between(p, nearest.1, nearest.1 + 1)
    }

    /// Returns the projection of `p` if the corridor strictly contains it: within the half-width of the
    /// baseline and not beyond its flat ends.
    fn in_corridor(&self, p: Vec2, lane: usize, half_width: f64, pieces: &[u32]) -> Option<Projection> {
        let line = &self.map.lanes[lane].baseline;
        let reach = half_width * half_width;
        let mut inside = false;
        let mut nearest = (f64::INFINITY, 0_usize);
        for &piece in pieces {
            // Pieces are bounded with their corridor.
            if self.index.piece_bounds[piece as usize].distance2(p) > BOUNDS_ERROR2 {
                continue;
            }
            let Piece { first, last, .. } = self.index.pieces[piece as usize];
            for i in first as usize..last as usize {
                let (a, b) = line.segment(i);
                let (d2, t) = point_segment(p, a, b);
                if d2 < nearest.0 {
                    nearest = (d2, i);
                }
                let beyond = (t <= 0.0 && i == 0) || (t >= 1.0 && i + 1 == line.segments());
                inside |= d2 < reach && !beyond;
            }
        }
        inside.then(|| line.project_between(p, nearest.1, nearest.1 + 1))
    }

    /// Finds the lanes whose baseline is within `radius` metres of `p`, in map order, and writes them to
    /// `hits` (cleared first).
    pub fn lanes_near(&self, p: Vec2, radius: f64, hits: &mut Vec<LaneHit>) {
        hits.clear();
        let mut found: Vec<u32> = Vec::new();
        self.index.piece_grid.visit(&Bounds::around(p, radius), |i| found.push(i));
        found.sort_unstable();
        found.dedup();
        for &i in &found {
            let Piece { lane, first, last } = self.index.pieces[i as usize];
            let line = &self.map.lanes[lane as usize].baseline;
            let projection = line.project_between(p, first as usize, last as usize);
            if projection.distance > radius || self.is_above_or_below(p, lane as usize, &projection) {
                continue;
            }
            match hits.last_mut() {
                Some(hit) if hit.lane == lane as usize => {
                    if projection.distance < hit.projection.distance {
                        hit.projection = projection;
                    }
                }
                _ => hits.push(LaneHit { lane: lane as usize, projection }),
            }
        }
    }

    /// Finds the nearest road edge; `start` is the segment found for a nearby point. `None` without edges.
    fn nearest_edge(&self, p: Vec2, start: Option<u32>) -> Option<NearestEdge> {
        if self.has_all_levels() {
            return self.index.edges.nearest(p, start);
        }
        self.index.edges.nearest_where(p, start, |i, t, d2| {
            let [a, b] = self.index.edge_heights[i as usize];
            !self.is_off_level(p, a + (b - a) * t, d2.sqrt())
        })
    }

    /// Returns whether a drivable polygon is on the level of the road near `p`: the height of a polygon is
    /// that of its nearest vertex.
    fn area_is_on_level(&self, area: usize, p: Vec2) -> bool {
        if self.has_all_levels() {
            return true;
        }
        let (Some(areas), Some(heights)) =
            (&self.map.drivable_area, self.map.heights.drivable_area.get(area))
        else {
            return true;
        };
        let vertices = areas[area].exterior.iter().zip(heights);
        let nearest = vertices.min_by(|a, b| (a.0 - p).norm_squared().total_cmp(&(b.0 - p).norm_squared()));
        nearest.is_none_or(|(vertex, &z)| !self.is_off_level(p, z, (vertex - p).norm()))
    }

    /// Returns whether the map records its drivable area.
    pub fn has_drivable_area(&self) -> bool {
        self.map.drivable_area.is_some() || !self.index.edges.is_empty()
    }

    /// Returns whether `p` is on drivable ground: strictly inside a polygon or, in maps without polygons,
    /// left of the nearest edge or strictly inside a driveway, which edges run past. `start` carries the
    /// nearest edge from one point of a track to the next. `None` if the map does not record its drivable
    /// area.
    pub fn drivable(&self, p: Vec2, start: &mut Option<u32>) -> Option<bool> {
        if self.map.drivable_area.is_some() {
            let areas = &self.index.areas;
            let inside = |&i: &u32| areas[i as usize].contains(p) && self.area_is_on_level(i as usize, p);
            return Some(self.index.area_grid.at(p).iter().any(inside));
        }
        let nearest = self.nearest_edge(p, *start)?;
        *start = Some(nearest.segment);
        Some(!nearest.outside || self.in_driveway(p))
    }

    fn in_driveway(&self, p: Vec2) -> bool {
        let at = self.index.driveway_grid.at(p);
        at.iter().any(|&i| point_in_ring(p, &self.map.driveways[i as usize].outline) == Some(true))
    }

    /// Returns the distance from `p` to the drivable ground, metres; 0 on it. `start` and `None` as in
    /// [`Road::drivable`].
    pub fn distance_off_road(&self, p: Vec2, start: &mut Option<u32>) -> Option<f64> {
        if let Some(area) = &self.map.drivable_area {
            if self.drivable(p, start)? {
                return Some(0.0);
            }
            let on_level = area.iter().enumerate().filter(|(i, _)| self.area_is_on_level(*i, p));
            let rings = on_level.flat_map(|(_, a)| std::iter::once(&a.exterior).chain(&a.holes));
            return Some(rings.map(|r| ring_distance(p, r)).fold(f64::INFINITY, f64::min));
        }
        let nearest = self.nearest_edge(p, *start)?;
        *start = Some(nearest.segment);
        if !nearest.outside || self.in_driveway(p) {
            return Some(0.0);
        }
        let driveways = self.map.driveways.iter();
        Some(driveways.map(|d| ring_distance(p, &d.outline)).fold(nearest.distance, f64::min))
    }

    /// Returns whether `p` is strictly inside a junction.
    pub fn in_intersection(&self, p: Vec2) -> bool {
        let at = self.index.intersection_grid.at(p);
        at.iter().any(|&i| point_in_ring(p, &self.map.intersections[i as usize]) == Some(true))
    }

    /// Returns the distance from `p` to the area of a lane, metres; 0 inside.
    pub fn distance_to_lane(&self, p: Vec2, lane: usize) -> f64 {
        match &self.map.lanes[lane].area {
            LaneArea::Polygon(ring) if self.is_in_lane(p, lane, ring) => 0.0,
            LaneArea::Polygon(ring) => ring_distance(p, ring),
            LaneArea::Corridor { half_width } => (self.project_on(p, lane).distance - half_width).max(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use reactsim_geometry::Polyline;

    use super::*;
    use crate::{LaneClass, LaneKind};

    /// Returns a lane through points that are `steps` apart, which begin at `start`.
    fn lane(start: (f64, f64), steps: &[(f64, f64)], half_width: Option<f64>) -> Option<Lane> {
        let mut at = Vec2::new(start.0, start.1);
        let mut points = vec![at];
        for step in steps {
            at += Vec2::new(step.0, step.1);
            points.push(at);
        }
        let baseline = Polyline::new(&points).ok()?;
        let everywhere = [(-200.0, -200.0), (200.0, -200.0), (200.0, 200.0), (-200.0, 200.0)];
        let area = match half_width {
            Some(half_width) => LaneArea::Corridor { half_width },
            None => LaneArea::Polygon(everywhere.map(|(x, y)| Vec2::new(x, y)).to_vec()),
        };
        Some(Lane {
            id: String::new(),
            kind: LaneKind::Lane,
            class: LaneClass::Undefined,
            speed_limit: None,
            baseline,
            area,
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: Vec::new(),
            right: Vec::new(),
        })
    }

    proptest! {
        #[test]
        fn projections_are_those_onto_the_whole_baseline(
            lanes in prop::collection::vec(
                (
                    (-60.0..60.0_f64, -60.0..60.0_f64),
                    prop::collection::vec((-4.0..6.0_f64, -4.0..4.0_f64), 1..90),
                    prop::option::of(0.5..3.0_f64),
                ),
                1..6,
            ),
            points in prop::collection::vec((-90.0..90.0_f64, -90.0..90.0_f64), 1..12),
            is_whole in any::<bool>(),
        ) {
            // Whole metres, so that there are ties.
            let rounded = |(x, y): &(f64, f64)| if is_whole { (x.round(), y.round()) } else { (*x, *y) };
            let made = lanes.iter().filter_map(|(start, steps, half_width)| {
                lane(rounded(start), &steps.iter().map(rounded).collect::<Vec<_>>(), *half_width)
            });
            let map = RoadMap { lanes: made.collect(), ..RoadMap::default() };
            let index = MapIndex::new(&map);
            let road = Road::new(&map, &index);
            for (x, y) in points.iter().map(rounded) {
                let p = Vec2::new(x, y);
                for (i, lane) in map.lanes.iter().enumerate() {
                    let whole = lane.baseline.project(p);
                    prop_assert_eq!(road.project_on(p, i), whole);
                    match lane.area {
                        LaneArea::Polygon(_) => prop_assert_eq!(road.lane_at(p, i), Some(whole)),
                        LaneArea::Corridor { half_width } => {
                            let distance = (whole.distance - half_width).max(0.0);
                            prop_assert_eq!(road.distance_to_lane(p, i), distance);
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn undefined_points_are_projected_onto_the_first_segment() {
        let lanes = vec![lane((0.0, 0.0), &[(1.0, 0.0); 40], Some(2.0)).unwrap()];
        let map = RoadMap { lanes, ..RoadMap::default() };
        let index = MapIndex::new(&map);
        let p = Vec2::new(f64::NAN, 1.0);
        let (found, whole) = (Road::new(&map, &index).project_on(p, 0), map.lanes[0].baseline.project(p));
        assert_eq!((found.segment, found.distance.to_bits()), (whole.segment, whole.distance.to_bits()));
    }
}
