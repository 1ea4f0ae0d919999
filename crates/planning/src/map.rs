//! The map as planners and their metrics see it: lanes and connectors in roadblocks, drivable ground and
//! intersections.

mod area;
mod areas;
mod drivable;

pub use area::Area;
pub use areas::Areas;
pub use drivable::DrivableArea;
pub use reactsim_scene::LaneKind;

use reactsim_geometry::{Bounds, OrientedBox, Polyline, Vec2};

use crate::PlanningError;
use crate::shapes::box_ring_distance;

/// A lane, or a connector: a lane through an intersection.
#[derive(Clone, Debug)]
pub struct PlanningLane {
    /// Name, unique in the map.
    pub id: String,
    /// Lane or connector.
    pub kind: LaneKind,
    /// Centre line in driving direction.
    pub baseline: Polyline,
    /// Speed limit, m/s, if known.
    pub speed_limit: Option<f64>,
    /// Index of its roadblock.
    pub roadblock: usize,
    /// Lanes that end where this one begins (indices into [`PlanningMap::lanes`]).
    pub predecessors: Vec<usize>,
    /// Lanes that begin where this one ends.
    pub successors: Vec<usize>,
}

impl PlanningLane {
    /// Returns whether this is a connector.
    pub fn is_connector(&self) -> bool {
        self.kind == LaneKind::Connector
    }
}

/// A group of parallel lanes, or of connectors between the same two groups.
#[derive(Clone, Debug)]
pub struct Roadblock {
    /// Name, unique in the map.
    pub id: String,
    /// Ground covered by the roadblock. `None`: the union of the areas of its lanes.
    pub area: Option<Area>,
}

/// The intersections of a map.
#[derive(Clone, Debug)]
pub enum Intersections {
    /// Inside these areas.
    Areas(Areas),
    /// The map has no outlines: wherever a connector is.
    Connectors,
    /// The map has neither outlines nor connectors that mark intersections.
    Unknown,
}

/// The parts of a [`PlanningMap`].
#[derive(Clone, Debug)]
pub struct PlanningMapParts {
    /// Lanes with their ground, in map order.
    pub lanes: Vec<(PlanningLane, Area)>,
    /// Roadblocks.
    pub roadblocks: Vec<Roadblock>,
    /// Intersections.
    pub intersections: Intersections,
    /// Drivable ground.
    pub drivable: DrivableArea,
}

/// A map with its spatial index. Containment is strict: the boundary of an area is outside.
#[derive(Clone, Debug)]
pub struct PlanningMap {
    lanes: Vec<PlanningLane>,
    areas: Areas,
    roadblocks: Vec<Roadblock>,
    lanes_of_roadblock: Vec<Vec<usize>>,
    intersections: Intersections,
    drivable: DrivableArea,
}

impl PlanningMap {
    /// Creates and indexes a map.
    ///
    /// # Errors
    /// [`PlanningError`] if a lane refers to a lane or a roadblock that is not in the map.
    pub fn new(parts: PlanningMapParts) -> Result<Self, PlanningError> {
        let (lanes, areas): (Vec<_>, Vec<_>) = parts.lanes.into_iter().unzip();
        check_links(&lanes, parts.roadblocks.len())?;
        let mut lanes_of_roadblock = vec![Vec::new(); parts.roadblocks.len()];
        for (i, lane) in lanes.iter().enumerate() {
            lanes_of_roadblock[lane.roadblock].push(i);
        }
        Ok(Self {
            lanes,
            areas: Areas::new(areas),
            roadblocks: parts.roadblocks,
            lanes_of_roadblock,
            intersections: parts.intersections,
            drivable: parts.drivable,
        })
    }

    /// Returns the lanes and connectors, in map order.
    pub fn lanes(&self) -> &[PlanningLane] {
        &self.lanes
    }

    /// Returns a lane.
    ///
    /// # Panics
    /// If the map has no lane with this index. Indices that the map returns are valid.
    pub fn lane(&self, lane: usize) -> &PlanningLane {
        &self.lanes[lane]
    }

    /// Returns the ground of a lane; panics as [`Self::lane`].
    pub fn lane_area(&self, lane: usize) -> &Area {
        &self.areas.list()[lane]
    }

    /// Returns the index of the lane with this id.
    pub fn find_lane(&self, id: &str) -> Option<usize> {
        self.lanes.iter().position(|lane| lane.id == id)
    }

    /// Returns whether the map has no lanes between intersections, as the maps of Waymo: every lane is a
    /// connector, and lanes overlap.
    pub(crate) fn has_connectors_only(&self) -> bool {
        !self.lanes.is_empty() && self.lanes.iter().all(PlanningLane::is_connector)
    }

    /// Returns the lanes and connectors that strictly contain `p`, in map order.
    pub fn lanes_at(&self, p: Vec2) -> Vec<usize> {
        self.areas.at(p).collect()
    }

    /// Returns the lanes and connectors whose bounds intersect `within`, in map order.
    pub(crate) fn lanes_within(&self, within: &Bounds) -> Vec<usize> {
        self.areas.within(within)
    }

    /// Returns whether the ground of a lane strictly contains `p`; panics as [`Self::lane`].
    pub(crate) fn lane_contains(&self, lane: usize, p: Vec2) -> bool {
        self.lane_area(lane).contains(p)
    }

    /// Returns the first of `lanes` that contains the centre of a box, else the lane nearest to the box, the
    /// first one on ties; `None` without lanes.
    pub(crate) fn nearest_lane(&self, lanes: &[usize], footprint: &OrientedBox) -> Option<usize> {
        let inside = lanes.iter().copied().find(|&lane| self.lane_contains(lane, footprint.center));
        inside.or_else(|| {
            let distance = |lane: usize| box_ring_distance(footprint, self.lane_area(lane).outline());
            let distances = lanes.iter().map(|&lane| (distance(lane), lane));
            distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, lane)| lane)
        })
    }

    /// Returns the roadblocks.
    pub fn roadblocks(&self) -> &[Roadblock] {
        &self.roadblocks
    }

    /// Returns the index of the roadblock with this id.
    pub(crate) fn find_roadblock(&self, id: &str) -> Option<usize> {
        self.roadblocks.iter().position(|roadblock| roadblock.id == id)
    }

    /// Returns the lanes of a roadblock, in map order.
    ///
    /// # Panics
    /// If the map has no roadblock with this index.
    pub fn lanes_of_roadblock(&self, roadblock: usize) -> &[usize] {
        &self.lanes_of_roadblock[roadblock]
    }

    /// Returns whether the ground of a roadblock strictly contains `p`; panics as
    /// [`Self::lanes_of_roadblock`].
    pub fn roadblock_contains(&self, roadblock: usize, p: Vec2) -> bool {
        match &self.roadblocks[roadblock].area {
            Some(area) => area.contains(p),
            None => self.lanes_of_roadblock[roadblock].iter().any(|&lane| self.lane_contains(lane, p)),
        }
    }

    /// Returns the intersections.
    pub fn intersections(&self) -> &Intersections {
        &self.intersections
    }

    /// Returns whether `p` is strictly inside an intersection; `None` if that is unknown. Without outlines,
    /// intersections are where connectors are.
    pub fn in_intersection(&self, p: Vec2) -> Option<bool> {
        match &self.intersections {
            Intersections::Areas(areas) => Some(areas.contains(p)),
            Intersections::Connectors => Some(self.areas.at(p).any(|lane| self.lanes[lane].is_connector())),
            Intersections::Unknown => None,
        }
    }

    /// Returns the drivable ground.
    pub fn drivable(&self) -> &DrivableArea {
        &self.drivable
    }
}

fn check_links(lanes: &[PlanningLane], roadblocks: usize) -> Result<(), PlanningError> {
    for lane in lanes {
        if let Some(&link) = lane.predecessors.iter().chain(&lane.successors).find(|&&l| l >= lanes.len()) {
            let (lane, lanes) = (&lane.id, lanes.len());
            let text =
                format!("lane `{lane}`: link to lane {link}, but the map has {lanes} lanes; remove the link");
            return Err(PlanningError(text));
        }
        if lane.roadblock >= roadblocks {
            let (lane, roadblock) = (&lane.id, lane.roadblock);
            let text = format!(
                "lane `{lane}`: roadblock {roadblock}, but the map has {roadblocks} roadblocks; add it"
            );
            return Err(PlanningError(text));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64) -> Vec2 {
        Vec2::new(x, y)
    }

    fn lane(id: &str, kind: LaneKind, x: [f64; 2]) -> (PlanningLane, Area) {
        let ring = vec![v(x[0], 0.0), v(x[1], 0.0), v(x[1], 3.5), v(x[0], 3.5)];
        let lane = PlanningLane {
            id: id.to_owned(),
            kind,
            baseline: Polyline::new(&[v(x[0], 1.75), v(x[1], 1.75)]).unwrap(),
            speed_limit: None,
            roadblock: 0,
            predecessors: Vec::new(),
            successors: Vec::new(),
        };
        (lane, Area::ring(ring).unwrap())
    }

    fn parts() -> PlanningMapParts {
        PlanningMapParts {
            lanes: vec![lane("a", LaneKind::Lane, [0.0, 10.0]), lane("c", LaneKind::Connector, [10.0, 20.0])],
            roadblocks: vec![Roadblock { id: "r".to_owned(), area: None }],
            intersections: Intersections::Connectors,
            drivable: DrivableArea::Unknown,
        }
    }

    #[test]
    fn borders_belong_to_no_lane() {
        let map = PlanningMap::new(parts()).unwrap();
        assert_eq!(map.lanes_at(v(5.0, 1.0)), [0]);
        assert!(map.lanes_at(v(10.0, 1.0)).is_empty());
        assert!(map.roadblock_contains(0, v(15.0, 1.0)));
        assert!(!map.roadblock_contains(0, v(10.0, 1.0)));
        assert_eq!(map.lanes_within(&Bounds::around(v(12.0, 1.0), 1.0)), [1]);
    }

    #[test]
    fn without_outlines_connectors_are_the_intersections() {
        let map = PlanningMap::new(parts()).unwrap();
        assert_eq!(map.in_intersection(v(5.0, 1.0)), Some(false));
        assert_eq!(map.in_intersection(v(15.0, 1.0)), Some(true));
        assert_eq!(map.drivable().contains(v(5.0, 1.0), &mut None), None);
    }

    #[test]
    fn links_out_of_the_map_are_refused() {
        let mut with_link = parts();
        with_link.lanes[0].0.successors = vec![7];
        let error = PlanningMap::new(with_link).unwrap_err();
        assert_eq!(error.to_string(), "lane `a`: link to lane 7, but the map has 2 lanes; remove the link");
        let mut with_block = parts();
        with_block.lanes[1].0.roadblock = 1;
        let error = PlanningMap::new(with_block).unwrap_err().to_string();
        assert_eq!(error, "lane `c`: roadblock 1, but the map has 1 roadblocks; add it");
    }
}
