//! Data shared by the checks: lanes as lines and areas, the points where they meet, the ground.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::{Bounds, PolygonIndex, Polyline, RingIndex, Vec2};
use reactsim_scene::{LaneArea, LaneKind, LaneParts};

use super::Layout;
use super::crossing::crossings;
use crate::heights::{height_at, on_different_levels};

/// A lane with its centre line and its area.
pub(super) struct TracedLane<'a> {
    pub(super) part: &'a LaneParts,
    pub(super) line: Polyline,
    /// The outline as an open ring.
    pub(super) ring: Vec<Vec2>,
    area: RingIndex,
    pub(super) bounds: Bounds,
    /// Height at each point of the line, metres; empty on maps without heights.
    pub(super) heights: &'a [f64],
}

impl TracedLane<'_> {
    pub(super) fn id(&self) -> &str {
        &self.part.id
    }

    pub(super) fn start(&self) -> Vec2 {
        self.line.points()[0]
    }

    pub(super) fn end(&self) -> Vec2 {
        self.line.points()[self.line.points().len() - 1]
    }

    /// Returns the height of the lane next to a point, metres, if known.
    pub(super) fn height(&self, p: Vec2) -> Option<f64> {
        if self.heights.is_empty() {
            None
        } else {
            height_at(&self.line, self.heights, self.line.project(p).s)
        }
    }

    /// Whether a point is inside the outline, or outside but within `margin` of it.
    pub(super) fn contains(&self, p: Vec2, margin: f64) -> bool {
        self.area.locate(p) == Some(true) || self.area.is_within(p, margin)
    }

    /// Whether a point is inside the outline and at least this far from it.
    pub(super) fn holds(&self, p: Vec2, depth: f64) -> bool {
        self.area.locate(p) == Some(true) && !self.area.is_within(p, depth)
    }

    /// Whether two lanes that share a point of the plane are on different levels there.
    pub(super) fn is_apart(&self, other: &Self, p: Vec2) -> bool {
        on_different_levels(self.height(p), other.height(p), 0.0)
    }

    pub(super) fn is_connector(&self) -> bool {
        self.part.kind == LaneKind::Connector
    }

    /// Returns the segments of the centre line.
    pub(super) fn segments(&self) -> impl Iterator<Item = (Vec2, Vec2)> {
        (0..self.line.segments()).map(|i| self.line.segment(i))
    }

    /// Returns the unit direction of segment `i`.
    pub(super) fn unit(&self, i: usize) -> Vec2 {
        let (a, b) = self.line.segment(i);
        (b - a).normalize()
    }
}

/// A layout prepared for the checks.
pub(super) struct Survey<'a> {
    pub(super) layout: &'a Layout,
    pub(super) lanes: Vec<TracedLane<'a>>,
    index: BTreeMap<&'a str, usize>,
    /// Pairs of lanes (lower index first) that meet: they cross, or end at the same place. Diverging lanes
    /// are not included.
    pub(super) meetings: BTreeMap<(usize, usize), Vec2>,
    ground: Vec<Ground<'a>>,
}

/// A polygon of drivable ground.
struct Ground<'a> {
    area: PolygonIndex,
    exterior: &'a [Vec2],
    /// Height at each point of the exterior, metres; empty on maps without heights.
    heights: &'a [f64],
}

impl Ground<'_> {
    /// Whether the ground near a point is on the level of `height`: its height is that of its nearest
    /// vertex.
    fn is_on_level(&self, p: Vec2, height: Option<f64>) -> bool {
        if height.is_none() {
            return true;
        }
        let vertices = self.exterior.iter().zip(self.heights);
        let nearest = vertices.min_by(|a, b| (a.0 - p).norm_squared().total_cmp(&(b.0 - p).norm_squared()));
        nearest.is_none_or(|(vertex, &z)| !on_different_levels(Some(z), height, (vertex - p).norm()))
    }
}

impl<'a> Survey<'a> {
    pub(super) fn new(layout: &'a Layout) -> Self {
        let mut index = BTreeMap::new();
        let heights = &layout.map.heights;
        let of = |list: &'a [Vec<f64>], i: usize| list.get(i).map_or(&[][..], Vec::as_slice);
        let trace = |(i, part): (usize, &'a LaneParts)| {
            assert_eq!(index.insert(part.id.as_str(), i), None, "another lane has the id {}", part.id);
            let line = Polyline::new(&part.points).unwrap();
            assert_eq!(line.points().len(), part.points.len(), "points of {} repeat", part.id);
            let ring = outline(part, &line);
            let (area, bounds) = (RingIndex::new(&ring), Bounds::of(ring.iter().copied()));
            TracedLane { part, line, ring, area, bounds, heights: of(&heights.lanes, i) }
        };
        let lanes = layout.map.lanes.iter().enumerate().map(trace).collect();
        let polygons = layout.map.drivable_area.iter().flatten().enumerate();
        let ground = polygons.map(|(i, p)| Ground {
            area: PolygonIndex::new(p),
            exterior: &p.exterior,
            heights: of(&heights.drivable_area, i),
        });
        let ground = ground.collect();
        for footway in &layout.footways {
            let (heights, points) = (&footway.heights, footway.line.points().len());
            assert!(heights.is_empty() || heights.len() == points && heights.iter().all(|z| z.is_finite()));
        }
        let mut survey = Self { layout, lanes, index, meetings: BTreeMap::new(), ground };
        survey.meetings = survey.find_meetings();
        survey
    }

    /// Returns the index of the lane with this id.
    pub(super) fn find(&self, id: &str) -> usize {
        self.index.get(id).copied().unwrap_or_else(|| panic!("no lane `{id}`"))
    }

    /// Returns the lane with this id.
    pub(super) fn lane(&self, id: &str) -> &TracedLane<'a> {
        &self.lanes[self.find(id)]
    }

    /// Returns the point where two lanes meet.
    pub(super) fn meet(&self, a: usize, b: usize) -> Option<Vec2> {
        self.meetings.get(&(a.min(b), a.max(b))).copied()
    }

    /// Returns the height of parked vehicles, metres, if the map has heights.
    pub(super) fn parking_height(&self) -> Option<f64> {
        (!self.layout.map.heights.is_empty()).then_some(0.0)
    }

    /// Whether a point at a height (unknown: any) is on drivable ground, or outside but within `tolerance`
    /// of its border.
    pub(super) fn drivable(&self, p: Vec2, height: Option<f64>, tolerance: f64) -> bool {
        let here = |g: &Ground<'_>| {
            (g.area.contains(p) || g.area.is_boundary_within(p, tolerance)) && g.is_on_level(p, height)
        };
        self.ground.iter().any(here)
    }

    /// Whether a point at a height (unknown: any) is on drivable ground and at least this far from its
    /// border.
    pub(super) fn well_drivable(&self, p: Vec2, height: Option<f64>, depth: f64) -> bool {
        let border = |g: &Ground<'_>| g.area.is_boundary_within(p, depth) && g.is_on_level(p, height);
        self.drivable(p, height, 0.0) && !self.ground.iter().any(border)
    }

    fn find_meetings(&self) -> BTreeMap<(usize, usize), Vec2> {
        let (mut pieces, mut lane_of) = (Vec::new(), Vec::new());
        for (i, lane) in self.lanes.iter().enumerate() {
            pieces.extend(lane.segments());
            lane_of.resize(pieces.len(), i);
        }
        let mut met = BTreeMap::new();
        crossings(&pieces, |k, m, at| {
            let (i, j) = (lane_of[k], lane_of[m]);
            if i != j && !self.related(i, j) && !self.lanes[i].is_apart(&self.lanes[j], at) {
                met.entry((i, j)).or_insert(at);
            }
        });
        let mut into: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (i, lane) in self.lanes.iter().enumerate() {
            for next in &lane.part.successors {
                into.entry(next.as_str()).or_default().push(i);
            }
        }
        for from in into.values() {
            for (k, &i) in from.iter().enumerate() {
                for &j in from[k + 1..].iter().filter(|&&j| j != i) {
                    met.entry((i.min(j), i.max(j))).or_insert(self.lanes[i].end());
                }
            }
        }
        met
    }

    /// Whether one lane follows the other, or both begin at the end of a third.
    fn related(&self, i: usize, j: usize) -> bool {
        let (a, b) = (self.lanes[i].part, self.lanes[j].part);
        let before = |l: &'a LaneParts| l.predecessors.iter().collect::<BTreeSet<_>>();
        a.successors.contains(&b.id)
            || b.successors.contains(&a.id)
            || before(a).intersection(&before(b)).next().is_some()
    }
}

/// Returns the outline of a lane as an open ring.
fn outline(part: &LaneParts, line: &Polyline) -> Vec<Vec2> {
    match &part.area {
        LaneArea::Polygon(ring) => {
            let mut ring = ring.clone();
            ring.dedup();
            if ring.len() > 1 && ring.first() == ring.last() {
                ring.pop();
            }
            ring
        }
        LaneArea::Corridor { half_width } => {
            let right = line.aside(-half_width);
            let left = line.aside(*half_width);
            right.points().iter().copied().chain(left.points().iter().rev().copied()).collect()
        }
    }
}
