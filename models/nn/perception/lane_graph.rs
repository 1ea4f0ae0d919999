//! Successor relation of lane pieces.

use reactsim_geometry::Vec2;

/// Successor relation of lane pieces.
#[derive(Clone, Debug, Default)]
pub(crate) struct LaneGraph {
    /// Successors of each place, with the direction in which the lane of each successor ends.
    pub(super) next: Vec<Vec<(usize, Vec2)>>,
}

impl LaneGraph {
    /// Builds the graph. `lanes` holds the lane of each place, `None` if it is not part of a lane;
    /// `aheads` its direction at the end; `successors` those of each lane.
    pub(crate) fn of(lanes: &[Option<usize>], aheads: &[Vec2], successors: &[Vec<usize>]) -> Self {
        let mut first = vec![None; successors.len()];
        let mut last = vec![None; successors.len()];
        for (place, lane) in lanes.iter().enumerate() {
            if let Some(lane) = *lane {
                first[lane].get_or_insert(place);
                last[lane] = Some(place);
            }
        }
        let end = |lane: usize| last[lane].map_or(Vec2::x(), |p: usize| aheads[p]);
        let follow = |(place, lane): (usize, &Option<usize>)| match *lane {
            // Consecutive pieces of a lane within range are neighbours in the list.
            Some(lane) if lanes.get(place + 1) == Some(&Some(lane)) => vec![(place + 1, end(lane))],
            Some(lane) => successors[lane].iter().filter_map(|&s| first[s].map(|p| (p, end(s)))).collect(),
            None => Vec::new(),
        };
        Self { next: lanes.iter().enumerate().map(follow).collect() }
    }
}
