//! The current lane and the centre line (tuplan_garage b51d5d0, `AbstractPDMPlanner` and `Dijkstra`).

use std::collections::BTreeSet;

use reactsim_geometry::wrap;

use crate::PlanningMap;
use crate::path::{baseline_states, nearest_state};
use crate::planner::PlannerInput;
use crate::trajectory::Pose;

/// Number of roadblocks that the centre line covers at most (tuplan_garage b51d5d0, `search_depth`).
const SEARCH_DEPTH: usize = 30;

/// Returns the lane of ego among `lanes`, the lanes of the route in its order: of the lanes that contain the
/// rear axle the one with the smallest heading difference, else the first one that contains the centre,
/// else the one nearest to the box. `None` without lanes.
pub(super) fn current_lane(
    input: &PlannerInput<'_>,
    lanes: &[usize],
    on_route: &BTreeSet<usize>,
) -> Option<usize> {
    let (map, ego) = (input.map, input.ego());
    let mut best: Option<(f64, usize)> = None;
    for &lane in on_route {
        let area = map.lane_area(lane);
        if !area.bounds().contains(ego.rear_axle()) || area.distance(ego.rear_axle()) > 0.0 {
            continue;
        }
        let (_, state) = nearest_state(&map.lane(lane).baseline, ego.rear_axle());
        let error = wrap(state.heading - ego.heading).abs();
        if best.is_none_or(|(least, _)| error < least) {
            best = Some((error, lane));
        }
    }
    best.map(|(_, lane)| lane).or_else(|| map.nearest_lane(lanes, &ego.footprint(input.shape)))
}

/// Returns the states of the centre line: the baselines of the shortest lane sequence from `start` along
/// the route.
pub(super) fn centerline_states(
    map: &PlanningMap,
    start: usize,
    route: &[usize],
    on_route: &BTreeSet<usize>,
) -> Vec<Pose> {
    let first = route.iter().position(|&block| block == map.lane(start).roadblock).unwrap_or(0);
    let window = &route[first..(first + SEARCH_DEPTH).min(route.len())];
    let lanes = shortest_lanes(map, start, window.last().copied(), on_route);
    lanes.into_iter().flat_map(|lane| baseline_states(&map.lane(lane).baseline)).collect()
}

/// A lane that a search has reached.
#[derive(Clone, Copy, Debug)]
struct Reached {
    lane: usize,
    cost: f64,
    depth: usize,
    /// Index of the lane before it among the expanded lanes.
    parent: Option<usize>,
}

/// Returns the cheapest lane sequence from `start` to a lane of the roadblock `target`, where entering a
/// lane costs its length. If there is none, the sequence ends at the deepest lane, the cheapest among
/// equals.
fn shortest_lanes(
    map: &PlanningMap,
    start: usize,
    target: Option<usize>,
    on_route: &BTreeSet<usize>,
) -> Vec<usize> {
    let mut frontier = vec![Reached { lane: start, cost: 0.0, depth: 1, parent: None }];
    let mut expanded: Vec<Reached> = Vec::new();
    while let Some(cheapest) = position_of_cheapest(&frontier) {
        let current = frontier.remove(cheapest);
        expanded.push(current);
        let parent = expanded.len() - 1;
        if Some(map.lane(current.lane).roadblock) == target {
            return sequence(&expanded, parent);
        }
        for &lane in map.lane(current.lane).successors.iter().filter(|lane| on_route.contains(lane)) {
            let cost = current.cost + map.lane(lane).baseline.length();
            let reached = Reached { lane, cost, depth: current.depth + 1, parent: Some(parent) };
            if expanded.iter().any(|other| other.lane == lane) {
                continue;
            }
            match frontier.iter_mut().find(|other| other.lane == lane) {
                Some(other) if cost < other.cost => *other = reached,
                Some(_) => {}
                None => frontier.push(reached),
            }
        }
    }
    sequence(&expanded, deepest(&expanded))
}

/// Returns the first index of the least cost.
fn position_of_cheapest(lanes: &[Reached]) -> Option<usize> {
    (0..lanes.len()).min_by(|&a, &b| lanes[a].cost.total_cmp(&lanes[b].cost))
}

/// Returns the index of the deepest lane, the cheapest among equals.
fn deepest(expanded: &[Reached]) -> usize {
    let mut best = 0;
    for (i, lane) in expanded.iter().enumerate() {
        let is_deeper = lane.depth > expanded[best].depth;
        if is_deeper || (lane.depth == expanded[best].depth && lane.cost < expanded[best].cost) {
            best = i;
        }
    }
    best
}

/// Returns the lanes from the first one to the expanded lane `last`.
fn sequence(expanded: &[Reached], last: usize) -> Vec<usize> {
    let mut lanes = Vec::new();
    let mut current = Some(last);
    while let Some(i) = current {
        lanes.push(expanded[i].lane);
        current = expanded[i].parent;
    }
    lanes.reverse();
    lanes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{LanePart, map};

    /// A fork after the first lane: a short lane that ends, and a long and a longer one to the goal.
    fn fork() -> PlanningMap {
        let lane = |id, roadblock, x, successors| LanePart { x, roadblock, successors, ..LanePart::new(id) };
        map(&[
            lane("start", "first", [0.0, 20.0], &["short", "longer", "long"]),
            lane("short", "second", [20.0, 30.0], &[]),
            lane("longer", "second", [20.0, 60.0], &["goal"]),
            lane("long", "second", [20.0, 50.0], &["goal"]),
            lane("goal", "third", [60.0, 90.0], &[]),
        ])
    }

    #[test]
    fn the_shortest_lanes_to_the_goal_are_taken() {
        let on_route = (0..5).collect();
        assert_eq!(shortest_lanes(&fork(), 0, Some(2), &on_route), [0, 3, 4]);
        let without_goal = (0..4).collect();
        assert_eq!(shortest_lanes(&fork(), 0, Some(2), &without_goal), [0, 1]);
    }

    #[test]
    fn the_states_of_all_lanes_are_joined() {
        let on_route = (0..5).collect();
        let states = centerline_states(&fork(), 0, &[0, 1, 2], &on_route);
        assert_eq!(states.len(), 21 + 31 + 31);
        let part = centerline_states(&fork(), 3, &[0, 1, 2], &on_route);
        assert_eq!(part[0].position.x, 20.0);
        assert_eq!(part[part.len() - 1].position.x, 90.0);
    }
}
