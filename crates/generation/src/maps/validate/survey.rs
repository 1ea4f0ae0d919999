//! Data shared by the checks: lanes as lines and areas, the points where they meet, the ground.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::{Bounds, Grid, Polyline, Vec2};
use reactsim_scene::{LaneArea, LaneKind, LaneParts};

use super::crossing::{cross, open_ring};
use super::region::Region;
use super::{Flaws, Layout, Rule};
use crate::heights::{height_at, on_different_levels};

/// A lane with its centre line and its area.
pub(super) struct TracedLane<'a> {
    pub(super) part: &'a LaneParts,
    pub(super) line: Polyline,
    /// The outline as an open ring.
    pub(super) ring: Vec<Vec2>,
    pub(super) area: Region,
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

    /// Whether two lanes that share a point of the plane are on different levels there.
    pub(super) fn is_apart(&self, other: &Self, p: Vec2) -> bool {
        on_different_levels(self.height(p), other.height(p), 0.0)
    }

    pub(super) fn is_connector(&self) -> bool {
        self.part.kind == LaneKind::Connector
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
    region: Region,
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
    pub(super) fn new(layout: &'a Layout, flaws: &mut Flaws) -> Self {
        let mut lanes: Vec<TracedLane<'a>> = Vec::new();
        let mut index = BTreeMap::new();
        let heights = &layout.map.heights;
        let of = |list: &'a [Vec<f64>], i: usize| list.get(i).map_or(&[][..], Vec::as_slice);
        for (i, part) in layout.map.lanes.iter().enumerate() {
            let first = part.points.first().copied().unwrap_or_default();
            match Polyline::new(&part.points) {
                _ if index.contains_key(part.id.as_str()) => {
                    flaws.add(Rule::Id, &part.id, first, "another lane has this id");
                }
                Ok(line) if line.points().len() == part.points.len() => {
                    let ring = outline(part, &line);
                    let area = Region::new([&ring[..]]);
                    index.insert(part.id.as_str(), lanes.len());
                    lanes.push(TracedLane { part, line, ring, area, heights: of(&heights.lanes, i) });
                }
                Ok(_) => flaws.add(Rule::Id, &part.id, first, "points of the centre line repeat"),
                Err(error) => flaws.add(Rule::Id, &part.id, first, error.to_string()),
            }
        }
        let polygons = layout.map.drivable_area.iter().flatten();
        let rings = |p: &'a reactsim_geometry::Polygon| {
            Region::new(std::iter::once(&p.exterior[..]).chain(p.holes.iter().map(|h| &h[..])))
        };
        let ground = polygons.enumerate().map(|(i, p)| Ground {
            region: rings(p),
            exterior: &p.exterior,
            heights: of(&heights.drivable_area, i),
        });
        let ground = ground.collect();
        let mut survey = Self { layout, lanes, index, meetings: BTreeMap::new(), ground };
        survey.meetings = survey.find_meetings();
        survey
    }

    pub(super) fn find(&self, id: &str) -> Option<usize> {
        self.index.get(id).copied()
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
            let near = g.region.contains(p) || tolerance > 0.0 && g.region.border_within(p, tolerance);
            near && g.is_on_level(p, height)
        };
        self.ground.iter().any(here)
    }

    /// Whether a point at a height (unknown: any) is on drivable ground and at least this far from its
    /// border.
    pub(super) fn well_drivable(&self, p: Vec2, height: Option<f64>, depth: f64) -> bool {
        let border = |g: &Ground<'_>| g.region.border_within(p, depth) && g.is_on_level(p, height);
        self.drivable(p, height, 0.0) && !self.ground.iter().any(border)
    }

    fn find_meetings(&self) -> BTreeMap<(usize, usize), Vec2> {
        let mut pieces: Vec<(usize, Vec2, Vec2)> = Vec::new();
        for (i, lane) in self.lanes.iter().enumerate() {
            pieces.extend(lane.line.points().windows(2).map(|w| (i, w[0], w[1])));
        }
        let bounds: Vec<Bounds> = pieces.iter().map(|p| Bounds::of([p.1, p.2])).collect();
        let grid = Grid::new(&bounds, 4.0);
        let mut met = BTreeMap::new();
        for (k, &(i, a, b)) in pieces.iter().enumerate() {
            grid.visit(&bounds[k], |m| {
                let (j, c, d) = pieces[m as usize];
                if i < j
                    && bounds[k].intersects(&bounds[m as usize])
                    && let Some(at) = cross(a, b, c, d).filter(|_| !self.related(i, j))
                    && !self.lanes[i].is_apart(&self.lanes[j], at)
                {
                    met.entry((i, j)).or_insert(at);
                }
            });
        }
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
        LaneArea::Polygon(ring) => open_ring(ring),
        LaneArea::Corridor { half_width } => {
            let right = line.aside(-half_width);
            let left = line.aside(*half_width);
            right.points().iter().copied().chain(left.points().iter().rev().copied()).collect()
        }
    }
}
