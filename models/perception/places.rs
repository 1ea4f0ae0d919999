//! Places of the map that agents attend to: pieces of lanes, edges and crosswalks, and stops.

use reactsim_geometry::Vec2;

use super::known_map::KnownMap;
use super::lane_graph::LaneGraph;
use super::place::Place;

/// All places of a map within range of the AV.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// Pieces, then stops.
    pub all: Vec<Place>,
    /// Successors of lane pieces.
    pub(crate) graph: LaneGraph,
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
        Self { all, graph }
    }
}
