//! Places of the map that agents attend to: pieces of lanes, edges and crosswalks, and stops.

use reactsim::geometry::Vec2;
use reactsim::scene::Start;

use super::config::Config;
use super::known_map::KnownMap;
use super::lane_graph::LaneGraph;
use super::links::{Links, Nearest};
use super::place::{PLACE_PAIR_FEATURES, Place};

/// All places of a map within range of the AV, with the neighbours of each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    /// Pieces, then stops.
    pub all: Vec<Place>,
    /// Links of each place to its nearest other places.
    pub links: Links,
    /// Successors of lane pieces.
    pub graph: LaneGraph,
}

impl Places {
    /// Returns the known places of a scenario.
    pub(crate) fn known(start: &Start, config: &Config) -> Self {
        Self::of(&KnownMap::of(start, config.map_radius), config)
    }

    /// Returns the places of a map.
    pub(crate) fn of(map: &KnownMap, config: &Config) -> Self {
        let mut places = Self::unlinked(map);
        let mut nearest = Nearest::new(config.map_neighbours);
        let mut found = Vec::new();
        for (i, place) in places.all.iter().enumerate() {
            nearest.clear();
            for (j, other) in places.all.iter().enumerate() {
                if i != j {
                    nearest.offer((other.middle - place.middle).norm_squared(), j);
                }
            }
            found.clear();
            found.extend(nearest.found());
            let relate = |j: usize, out: &mut [f32]| place.relate_place(&places.all[j], out);
            places.links.push(config.map_neighbours, PLACE_PAIR_FEATURES, &found, relate);
        }
        places
    }

    /// Returns the places of a map, without the neighbours of each.
    pub(crate) fn unlinked(map: &KnownMap) -> Self {
        let KnownMap { pieces, stops, light_lanes, successors } = map;
        let light_of = |lane: usize| light_lanes.iter().position(|&l| l == lane);
        let mut all: Vec<Place> =
            pieces.iter().map(|p| Place::of_piece(p, p.lane.and_then(light_of))).collect();
        all.extend(stops.iter().map(Place::of_stop));
        let lanes: Vec<Option<usize>> = pieces.iter().map(|p| p.lane.filter(|_| p.kind.is_lane())).collect();
        let aheads: Vec<Vec2> = all.iter().map(|p| p.end_ahead()).collect();
        let graph = LaneGraph::of(&lanes, &aheads, successors);
        Self { all, links: Links::default(), graph }
    }

    /// Returns only the places that are used and those within `hops` links of them, on which their
    /// encoding depends; and the new index of each old one.
    pub(crate) fn reduced(&self, used: impl IntoIterator<Item = usize>, hops: usize) -> (Self, Vec<u32>) {
        let n = self.all.len();
        let k = self.links.index.len().checked_div(n).unwrap_or(0);
        let neighbours = |i: usize| (i * k..(i + 1) * k).filter(|&at| self.links.open[at]);
        let mut kept = vec![false; n];
        let mut border: Vec<usize> =
            used.into_iter().filter(|&i| !std::mem::replace(&mut kept[i], true)).collect();
        for _ in 0..hops {
            let reached = border.iter().flat_map(|&i| neighbours(i)).map(|at| self.links.index[at] as usize);
            border = reached.filter(|&j| !std::mem::replace(&mut kept[j], true)).collect();
        }
        let mut moved = vec![u32::MAX; n];
        let mut reduced = Self::default();
        for i in (0..n).filter(|&i| kept[i]) {
            moved[i] = reduced.all.len() as u32;
            reduced.all.push(self.all[i].clone());
        }
        for i in (0..n).filter(|&i| kept[i]) {
            // Neighbours of the outermost places may be missing: no used place depends on them.
            let there: Vec<usize> = neighbours(i).filter(|&at| kept[self.links.index[at] as usize]).collect();
            reduced.links.push(k, PLACE_PAIR_FEATURES, &there, |at, out| {
                out.copy_from_slice(
                    &self.links.relation[at * PLACE_PAIR_FEATURES..(at + 1) * PLACE_PAIR_FEATURES],
                );
            });
            let row = reduced.links.index.len() - k;
            for slot in 0..there.len() {
                let at = reduced.links.index[row + slot] as usize;
                reduced.links.index[row + slot] = moved[self.links.index[at] as usize];
            }
        }
        (reduced, moved)
    }
}
