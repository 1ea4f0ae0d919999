//! The lanes that ego is in, by the centre of its box (nuPlan devkit 1.2.2, `get_route`).

use reactsim_geometry::Vec2;

use crate::PlanningMap;

/// Distance in metres below which ego keeps the connectors of the previous sample while it is inside an
/// intersection, but in none of them (devkit 1.2.2).
const KEPT_CONNECTOR_DISTANCE: f64 = 5.0;
/// First sample at which connectors can be kept (devkit 1.2.2).
const FIRST_KEEPING_SAMPLE: usize = 2;

/// Returns the lanes at each of the successive `centers`: indices into the lanes of the map, most often one;
/// none outside all lanes.
///
/// In maps of connectors only, lanes overlap: several lanes may stay, connectors are not kept by distance,
/// and a sample without lanes does not empty the lists before it.
pub fn center_lanes(map: &PlanningMap, centers: &[Vec2]) -> Vec<Vec<usize>> {
    let mut lanes = forward_pass(map, centers);
    backward_pass(map, &mut lanes);
    lanes
}

/// Returns the lanes between intersections that contain `p`; if there are none, the connectors that contain
/// it, in map order.
pub(super) fn find_lanes(map: &PlanningMap, p: Vec2) -> Vec<usize> {
    let (connectors, lanes): (Vec<_>, Vec<_>) =
        map.lanes_at(p).into_iter().partition(|&lane| map.lane(lane).is_connector());
    if lanes.is_empty() { connectors } else { lanes }
}

/// Returns the `candidates` that contain `p`; if there are none and there is exactly one candidate, its
/// successors that contain `p`.
pub(super) fn continue_lanes(map: &PlanningMap, candidates: &[usize], p: Vec2) -> Vec<usize> {
    let containing = |lanes: &[usize]| -> Vec<usize> {
        lanes.iter().copied().filter(|&lane| map.lane_contains(lane, p)).collect()
    };
    match (containing(candidates), candidates) {
        (found, &[only]) if found.is_empty() => containing(&map.lane(only).successors),
        (found, _) => found,
    }
}

fn forward_pass(map: &PlanningMap, centers: &[Vec2]) -> Vec<Vec<usize>> {
    let mut all: Vec<Vec<usize>> = Vec::with_capacity(centers.len());
    for (k, &center) in centers.iter().enumerate() {
        let previous = all.last().map_or(&[][..], Vec::as_slice);
        let continued = continue_lanes(map, previous, center);
        let lanes = if continued.is_empty() {
            let found = find_lanes(map, center);
            let kept = if k < FIRST_KEEPING_SAMPLE {
                Vec::new()
            } else {
                kept_connectors(map, previous, &found, center)
            };
            if kept.is_empty() { found } else { kept }
        } else {
            continued
        };
        all.push(lanes);
    }
    all
}

/// Returns the lanes of the previous sample that are near enough to be kept inside an intersection.
fn kept_connectors(map: &PlanningMap, previous: &[usize], found: &[usize], center: Vec2) -> Vec<usize> {
    let starts_with_connector = |lanes: &[usize]| lanes.first().is_some_and(|&l| map.lane(l).is_connector());
    let in_intersection = || found.is_empty() && map.in_intersection(center) == Some(true);
    let keeps = !map.has_connectors_only()
        && starts_with_connector(previous)
        && (starts_with_connector(found) || in_intersection());
    if !keeps {
        return Vec::new();
    }
    let is_near = |&lane: &usize| map.lane_area(lane).distance(center) < KEPT_CONNECTOR_DISTANCE;
    previous.iter().copied().filter(is_near).collect()
}

/// Reduces lists of several lanes to those that lead to the lanes of the next sample.
///
/// The devkit empties a list if the next one is empty, which then empties the ones before it as well.
fn backward_pass(map: &PlanningMap, lanes: &mut [Vec<usize>]) {
    let empties = !map.has_connectors_only();
    for k in (0..lanes.len().saturating_sub(1)).rev() {
        let (before, after) = lanes.split_at_mut(k + 1);
        let (old, next) = (&mut before[k], &after[0]);
        if old.len() > 1
            && let Some(reduced) = leading_to(map, old, next)
            && (empties || !reduced.is_empty())
        {
            *old = reduced;
        }
    }
}

/// Returns the part of `old` that leads to `next`; `None` if all of it may stay.
fn leading_to(map: &PlanningMap, old: &[usize], next: &[usize]) -> Option<Vec<usize>> {
    if let Some(&first) = next.first()
        && !map.lane(first).is_connector()
    {
        let before = &map.lane(first).predecessors;
        let leading: Vec<usize> = old.iter().copied().filter(|lane| before.contains(lane)).collect();
        if !leading.is_empty() {
            return Some(leading);
        }
    }
    let narrows = old.len() > next.len() && next.iter().all(|lane| old.contains(lane));
    narrows.then(|| next.to_vec())
}
