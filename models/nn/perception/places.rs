//! Places of the map that agents attend to: pieces of lanes, edges and crosswalks, and stops.

use std::sync::OnceLock;

use reactsim_geometry::Vec2;

use super::known_map::KnownMap;
use super::lane_graph::LaneGraph;
use super::place::Place;
use super::point_index::PointIndex;

/// All places of a map within range of the AV.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// Pieces, then stops.
    pub all: Vec<Place>,
    /// Successors of lane pieces.
    pub(crate) graph: LaneGraph,
    /// Index of their middles, made when it is first asked for.
    middles: OnceLock<PointIndex>,
}

impl Places {
    /// Returns the places of a map.
    pub fn of(map: &KnownMap) -> Self {
        let KnownMap { pieces, stops, light_lanes, successors } = map;
        let light_of = |lane: usize| light_lanes.iter().position(|&l| l == lane);
        let mut all: Vec<Place> =
            pieces.iter().map(|p| Place::of_piece(p, p.lane.and_then(light_of))).collect();
        all.extend(stops.iter().map(Place::of_stop));
        let lanes: Vec<Option<usize>> = pieces.iter().map(|p| p.lane.filter(|_| p.kind.is_lane())).collect();
        let aheads: Vec<Vec2> = all.iter().map(|p| p.end_ahead()).collect();
        let graph = LaneGraph::of(&lanes, &aheads, successors);
        Self { all, graph, middles: OnceLock::new() }
    }

    /// Returns the index of the middles of all places.
    pub fn middles(&self) -> &PointIndex {
        self.middles.get_or_init(|| PointIndex::new(self.all.iter().map(|place| place.middle).collect()))
    }
}
