//! One lane per sample, out of the lanes that a vehicle is in.

use reactsim_geometry::{Vec2, direction};

use crate::{EgoState, PlanningMap};

/// Returns whether lanes overlap: in maps of connectors only, and where one of the lists has several lanes
/// between intersections.
pub(super) fn lanes_overlap<'l>(map: &PlanningMap, lists: impl IntoIterator<Item = &'l Vec<usize>>) -> bool {
    let is_several = |lanes: &Vec<usize>| lanes.len() > 1 && !map.lane(lanes[0]).is_connector();
    map.has_connectors_only() || lists.into_iter().any(is_several)
}

/// Returns the lane that counts at each sample, out of `lanes` per sample; `None` in no lane.
///
/// It is the first lane. If lanes overlap, it is the lane of the sample before if the vehicle is still in it,
/// else its successor, else the lane that is most parallel to the heading.
pub(super) fn matched_lanes(
    map: &PlanningMap,
    lanes: &[Vec<usize>],
    states: &[EgoState],
    centers: &[Vec2],
    overlap: bool,
) -> Vec<Option<usize>> {
    let mut before: Option<usize> = None;
    let mut matched = Vec::with_capacity(lanes.len());
    for (k, lanes) in lanes.iter().enumerate() {
        let lane = if overlap {
            following(map, lanes, before).or_else(|| most_parallel(map, lanes, states[k].heading, centers[k]))
        } else {
            lanes.first().copied()
        };
        before = lane.or(before);
        matched.push(lane);
    }
    matched
}

/// Returns the lane before, or its first successor, among `lanes`.
fn following(map: &PlanningMap, lanes: &[usize], before: Option<usize>) -> Option<usize> {
    let before = before?;
    let successors = &map.lane(before).successors;
    std::iter::once(&before).chain(successors).copied().find(|lane| lanes.contains(lane))
}

/// Returns the lane whose direction next to `center` is nearest to the heading; the first one on ties.
fn most_parallel(map: &PlanningMap, lanes: &[usize], heading: f64, center: Vec2) -> Option<usize> {
    let ahead = direction(heading);
    let alignment = |&lane: &usize| {
        let baseline = &map.lane(lane).baseline;
        let (a, b) = baseline.segment(baseline.project(center).segment);
        ahead.dot(&(b - a).normalize())
    };
    lanes.iter().rev().max_by(|a, b| alignment(a).total_cmp(&alignment(b))).copied()
}
