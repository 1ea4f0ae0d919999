//! Correction of the route at the first iteration (tuplan_garage b51d5d0, `route_utils` and
//! `BreadthFirstSearchRoadBlock`).

use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_4;

use reactsim_geometry::{Polygon, Vec2, ring_area, union, wrap};

use super::areas::{is_connector_block, roadblock_outlines, roadblocks_near};
use crate::PlanningMap;
use crate::path::nearest_state;
use crate::search::{Layer, path_to};
use crate::trajectory::Pose;

/// Half of the side in metres of the square around the rear axle in which the first roadblock is searched
/// (tuplan_garage b51d5d0).
const START_RADIUS: f64 = 1.0;
/// Largest heading difference between ego and the first lane, radians (tuplan_garage b51d5d0,
/// `heading_error_thresh`).
const MAX_HEADING_ERROR: f64 = FRAC_PI_4;
/// Largest distance in metres between ego and a state of the first lane (tuplan_garage b51d5d0,
/// `displacement_error_thresh`).
const MAX_DISTANCE: f64 = 3.0;
/// Largest number of roadblocks of a search against the driving direction (tuplan_garage b51d5d0,
/// `search_depth_backward`).
const BACKWARD_DEPTH: usize = 15;
/// Largest number of roadblocks of a search in driving direction (tuplan_garage b51d5d0,
/// `search_depth_forward`).
const FORWARD_DEPTH: usize = 30;
/// Number of roadblocks of the route, from its start, that a search in driving direction may reach
/// (tuplan_garage b51d5d0).
const REACHABLE_BLOCKS: usize = 3;
/// Overlap of connector blocks, m², above which the route is a loop (tuplan_garage b51d5d0).
const LOOP_OVERLAP: f64 = 1.0;

/// Returns the route from where ego is, `route` being roadblocks in driving order: it begins at the
/// roadblock of ego if that is linked to the route, has no gaps that can be filled, and ends before it
/// crosses itself. `None` if no roadblock is near ego.
pub(super) fn corrected(map: &PlanningMap, ego: Pose, route: &[usize]) -> Option<Vec<usize>> {
    let start = Start::find(map, ego, route)?;
    let route = linked_to_start(map, &start, route);
    let mut route = without_gaps(map, &route);
    route.truncate(loop_begin(map, &route));
    let mut seen = BTreeSet::new();
    route.retain(|block| seen.insert(*block));
    Some(route)
}

/// The roadblock of ego, and the candidates for it.
#[derive(Debug)]
struct Start {
    block: usize,
    candidates: Vec<usize>,
}

/// A lane near ego.
#[derive(Clone, Copy, Debug)]
struct NearLane {
    block: usize,
    distance: f64,
    heading_error: f64,
}

impl Start {
    /// Finds the roadblock of ego: the nearest with a lane along ego, those of the route first; if no
    /// lane is along ego, the nearest roadblock.
    fn find(map: &PlanningMap, ego: Pose, route: &[usize]) -> Option<Self> {
        let lanes = near_lanes(map, ego);
        let is_along =
            |lane: &&NearLane| lane.heading_error < MAX_HEADING_ERROR && lane.distance < MAX_DISTANCE;
        let (on_route, off_route): (Vec<NearLane>, Vec<NearLane>) =
            lanes.iter().filter(is_along).partition(|lane| route.contains(&lane.block));
        let candidates = [on_route, off_route, lanes].into_iter().find(|lanes| !lanes.is_empty())?;
        let mut nearest = candidates[0];
        for lane in &candidates {
            if lane.distance < nearest.distance {
                nearest = *lane;
            }
        }
        Some(Self { block: nearest.block, candidates: candidates.iter().map(|lane| lane.block).collect() })
    }
}

/// Returns the lanes of the roadblocks that ego may be in.
fn near_lanes(map: &PlanningMap, ego: Pose) -> Vec<NearLane> {
    let mut blocks = roadblocks_near(map, ego.position, START_RADIUS);
    if blocks.is_empty() {
        blocks = [false, true]
            .into_iter()
            .filter_map(|is_connector| nearest_block(map, ego.position, is_connector))
            .collect();
    }
    let lanes = blocks
        .into_iter()
        .flat_map(|block| map.lanes_of_roadblock(block).iter().map(move |&lane| (block, lane)));
    lanes
        .map(|(block, lane)| {
            let (distance, state) = nearest_state(&map.lane(lane).baseline, ego.position);
            NearLane { block, distance, heading_error: wrap(state.heading - ego.heading).abs() }
        })
        .collect()
}

/// Returns the roadblock of lanes or of connectors that is nearest to `p`.
fn nearest_block(map: &PlanningMap, p: Vec2, is_connector: bool) -> Option<usize> {
    let lanes = (0..map.lanes().len()).filter(|&lane| map.lane(lane).is_connector() == is_connector);
    let distances = lanes.map(|lane| (map.lane_area(lane).distance(p), map.lane(lane).roadblock));
    distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, block)| block)
}

/// Returns the route, begun at the roadblock of ego if that is off the route and a search links it.
fn linked_to_start(map: &PlanningMap, start: &Start, route: &[usize]) -> Vec<usize> {
    if route.contains(&start.block) {
        return route.to_vec();
    }
    let Some(&first) = route.first() else { return Vec::new() };
    if let Some(mut path) = search(map, first, &start.candidates, BACKWARD_DEPTH, Direction::Backward) {
        // The path ends with the first roadblock of the route.
        path.pop();
        path.extend_from_slice(route);
        return path;
    }
    let targets = &route[..route.len().min(REACHABLE_BLOCKS)];
    let Some(mut path) = search(map, start.block, targets, FORWARD_DEPTH, Direction::Forward) else {
        return route.to_vec();
    };
    let reached = route.iter().position(|block| path.last() == Some(block)).unwrap_or(0);
    path.extend_from_slice(&route[reached + 1..]);
    path
}

/// Returns the route with the roadblocks between neighbours that are not linked, where a search finds them.
pub(crate) fn without_gaps(map: &PlanningMap, route: &[usize]) -> Vec<usize> {
    let mut filled = Vec::with_capacity(route.len());
    for (i, &block) in route.iter().enumerate() {
        filled.push(block);
        let Some(&next) = route.get(i + 1) else { break };
        if neighbors(map, next, Direction::Backward).contains(&block) {
            continue;
        }
        if let Some(path) = search(map, block, &[next], FORWARD_DEPTH, Direction::Forward)
            && path.len() > 2
        {
            filled.extend_from_slice(&path[1..path.len() - 1]);
        }
    }
    filled
}

/// Returns the number of roadblocks before the first connector block that overlaps an earlier one. In maps of
/// connectors only, where lanes beside the route overlap it everywhere, that shows no loop.
fn loop_begin(map: &PlanningMap, route: &[usize]) -> usize {
    if map.has_connectors_only() {
        return route.len();
    }
    let mut earlier: Vec<Vec<Polygon>> = Vec::new();
    for (i, &block) in route.iter().enumerate().filter(|&(_, &block)| is_connector_block(map, block)) {
        let outlines: Vec<Vec<Vec2>> =
            roadblock_outlines(map, block).into_iter().map(<[Vec2]>::to_vec).collect();
        let ground = union(&outlines, &[]);
        if earlier.iter().any(|other| overlap(other, &ground) > LOOP_OVERLAP) {
            return i;
        }
        earlier.push(ground);
    }
    route.len()
}

/// Returns the area that two grounds share, m².
fn overlap(a: &[Polygon], b: &[Polygon]) -> f64 {
    let rings: Vec<Vec<Vec2>> = a.iter().chain(b).map(|polygon| polygon.exterior.clone()).collect();
    let holes: Vec<Vec<Vec2>> = Vec::new();
    area(a) + area(b) - area(&union(&rings, &holes))
}

/// Returns the area of polygons that do not overlap, m².
fn area(polygons: &[Polygon]) -> f64 {
    let of = |polygon: &Polygon| {
        let holes: f64 = polygon.holes.iter().map(|hole| ring_area(hole).abs()).sum();
        ring_area(&polygon.exterior).abs() - holes
    };
    polygons.iter().map(of).sum()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Direction {
    Forward,
    Backward,
}

/// Returns the roadblocks linked to a roadblock, by index.
fn neighbors(map: &PlanningMap, block: usize, direction: Direction) -> BTreeSet<usize> {
    let lanes = map.lanes_of_roadblock(block).iter().map(|&lane| map.lane(lane));
    let linked = lanes.flat_map(|lane| match direction {
        Direction::Forward => &lane.successors,
        Direction::Backward => &lane.predecessors,
    });
    linked.map(|&lane| map.lane(lane).roadblock).filter(|&other| other != block).collect()
}

/// Returns the shortest path in driving order between `start` and one of `targets`, both included; `None`
/// if there is none of at most `depth` roadblocks.
///
/// Among shortest paths it is the one that a breadth-first search finds which visits roadblocks again and
/// keeps the last parent of each roadblock and depth.
fn search(
    map: &PlanningMap,
    start: usize,
    targets: &[usize],
    depth: usize,
    direction: Direction,
) -> Option<Vec<usize>> {
    let mut layers = vec![Layer::of(start)];
    while layers.len() <= depth {
        let layer = &layers[layers.len() - 1];
        if let Some(&found) = layer.nodes().iter().find(|block| targets.contains(block)) {
            let mut path = path_to(&layers, found);
            if direction == Direction::Backward {
                path.reverse();
            }
            return Some(path);
        }
        let next = layer.next(|block| neighbors(map, block, direction));
        if next.nodes().is_empty() {
            return None;
        }
        layers.push(next);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{LanePart, map};
    use crate::map::LaneKind;

    fn lane(
        id: &'static str,
        roadblock: &'static str,
        x: [f64; 2],
        bottom: f64,
        successors: &'static [&'static str],
    ) -> LanePart {
        LanePart { x, bottom, roadblock, successors, ..LanePart::new(id) }
    }

    /// A road of four roadblocks, with a lane beside the second that leads to the third.
    fn road() -> PlanningMap {
        map(&[
            lane("a", "0", [0.0, 50.0], 0.0, &["b", "s"]),
            lane("b", "1", [50.0, 100.0], 0.0, &["c"]),
            lane("c", "2", [100.0, 150.0], 0.0, &["d"]),
            lane("d", "3", [150.0, 200.0], 0.0, &[]),
            lane("s", "side", [50.0, 100.0], 20.0, &["c"]),
        ])
    }

    fn at(x: f64, y: f64) -> Pose {
        Pose { position: Vec2::new(x, y), heading: 0.0 }
    }

    #[test]
    fn routes_through_ego_are_kept() {
        assert_eq!(corrected(&road(), at(60.0, 1.75), &[0, 1, 2, 3]), Some(vec![0, 1, 2, 3]));
    }

    #[test]
    fn routes_begin_at_ego() {
        // Before the route: linked by a search from its first roadblock backwards.
        assert_eq!(corrected(&road(), at(10.0, 1.75), &[2, 3]), Some(vec![0, 4, 2, 3]));
        // Beside the route: the roadblocks that ego has passed are left out.
        assert_eq!(corrected(&road(), at(60.0, 21.75), &[1, 2, 3]), Some(vec![4, 2, 3]));
    }

    #[test]
    fn gaps_are_filled() {
        // Of the paths of equal length, the one that is found last is kept.
        assert_eq!(corrected(&road(), at(10.0, 1.75), &[0, 2, 3]), Some(vec![0, 4, 2, 3]));
        assert_eq!(corrected(&road(), at(60.0, 1.75), &[1, 3]), Some(vec![1, 2, 3]));
    }

    #[test]
    fn routes_end_before_they_cross_themselves() {
        let connector = |id, roadblock, x: [f64; 2], successors| LanePart {
            kind: LaneKind::Connector,
            ..lane(id, roadblock, x, 0.0, successors)
        };
        let crossing = |end: f64| {
            map(&[
                lane("a", "0", [0.0, 50.0], 0.0, &["x"]),
                connector("x", "1", [50.0, 60.0], &["b"]),
                lane("b", "2", [60.0, 100.0], 0.0, &["y"]),
                connector("y", "3", [end, 50.0], &[]),
            ])
        };
        let route = [0, 1, 2, 3];
        assert_eq!(corrected(&crossing(52.0), at(10.0, 1.75), &route), Some(vec![0, 1, 2]));
        assert_eq!(corrected(&crossing(40.0), at(10.0, 1.75), &route), Some(route.to_vec()));
    }

    #[test]
    fn connectors_in_succession_are_no_loop() {
        let connector = |id, roadblock, x: [f64; 2], successors| LanePart {
            kind: LaneKind::Connector,
            ..lane(id, roadblock, x, 0.0, successors)
        };
        let road = map(&[
            connector("a", "0", [0.0, 50.0], &["b"]),
            connector("b", "1", [50.0, 85.0], &["c"]),
            connector("c", "2", [45.0, 120.0], &[]),
        ]);
        assert_eq!(corrected(&road, at(10.0, 1.75), &[0, 1, 2]), Some(vec![0, 1, 2]));
    }

    #[test]
    fn far_from_all_lanes_the_nearest_roadblock_counts() {
        assert_eq!(corrected(&road(), at(120.0, -30.0), &[2, 3]), Some(vec![2, 3]));
        assert_eq!(corrected(&map(&[]), at(0.0, 0.0), &[]), None);
    }
}
