//! Places with their neighbours, to which they attend.

use reactsim_nn::Links;
use reactsim_nn::perception::{KnownMap, Nearest, Places};
use reactsim_scene::Start;

use super::config::Config;
use super::place_relations::{PLACE_PAIR_FEATURES, relate_places};

/// Places of a map with the neighbours of each.
#[derive(Clone, Debug, Default)]
pub(crate) struct LinkedPlaces {
    /// The places.
    pub places: Places,
    /// Links of each place to its nearest other places.
    pub links: Links,
}

impl LinkedPlaces {
    /// Returns the known places of a scenario.
    pub(crate) fn known(start: &Start, config: &Config) -> Self {
        Self::of(&KnownMap::of(start, config.map_radius), config)
    }

    pub(crate) fn of(map: &KnownMap, config: &Config) -> Self {
        let places = Places::of(map);
        let mut links = Links::default();
        let mut nearest = Nearest::new(config.map_neighbours);
        let mut found = Vec::new();
        for (i, place) in places.all.iter().enumerate() {
            places.middles().nearest(place.middle, |j| j != i, &mut nearest);
            found.clear();
            found.extend(nearest.found());
            let relate = |j: usize, out: &mut [f32]| relate_places(place, &places.all[j], out);
            links.push(config.map_neighbours, PLACE_PAIR_FEATURES, &found, relate);
        }
        Self { places, links }
    }

    /// Returns only the places that are used and those within `hops` links of them, on which their
    /// encoding depends; and the new index of each old one.
    pub(crate) fn reduced(&self, used: impl IntoIterator<Item = usize>, hops: usize) -> (Self, Vec<u32>) {
        let n = self.places.all.len();
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
            moved[i] = reduced.places.all.len() as u32;
            reduced.places.all.push(self.places.all[i].clone());
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
