//! The lanes that the corners of ego are in, and whether they are in a common lane (nuPlan devkit 1.2.2,
//! `extract_corners_route`).

use reactsim_geometry::{OrientedBox, Vec2};

use crate::PlanningMap;

use super::center_lanes::{continue_lanes, find_lanes};

/// A corner of ego.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Corner {
    /// Front left.
    FrontLeft,
    /// Rear left.
    RearLeft,
    /// Rear right.
    RearRight,
    /// Front right.
    FrontRight,
}

impl Corner {
    /// All corners, in the order in which the devkit visits them.
    pub const ALL: [Self; 4] = [Self::FrontLeft, Self::RearLeft, Self::RearRight, Self::FrontRight];

    /// Returns the point of a box at this corner, metres.
    pub fn of(self, footprint: &OrientedBox) -> Vec2 {
        let [front_left, front_right, rear_right, rear_left] = footprint.corners();
        match self {
            Self::FrontLeft => front_left,
            Self::RearLeft => rear_left,
            Self::RearRight => rear_right,
            Self::FrontRight => front_right,
        }
    }
}

/// The lanes of the four corners, in the order of [`Corner::ALL`]: indices into the lanes of the map.
pub type CornerLanes = [Vec<usize>; 4];

/// Sample at which the lanes found for a corner become candidates for the next corners of the same sample
/// (devkit 1.2.2).
const SHARING_SAMPLE: usize = 1;

/// Returns the lanes of the corners of the successive boxes of ego.
pub fn corner_lanes(map: &PlanningMap, footprints: &[OrientedBox]) -> Vec<CornerLanes> {
    let mut all: Vec<CornerLanes> = Vec::with_capacity(footprints.len());
    for (k, footprint) in footprints.iter().enumerate() {
        let mut candidates = all.last().map_or_else(Vec::new, union);
        let lanes = Corner::ALL.map(|corner| {
            let p = corner.of(footprint);
            let continued = continue_lanes(map, &candidates, p);
            if !continued.is_empty() {
                return continued;
            }
            let found = find_lanes(map, p);
            if k == SHARING_SAMPLE {
                add_missing(&mut candidates, &found);
            }
            found
        });
        all.push(lanes);
    }
    all
}

fn union(corners: &CornerLanes) -> Vec<usize> {
    let mut all = Vec::new();
    corners.iter().for_each(|lanes| add_missing(&mut all, lanes));
    all
}

fn add_missing(all: &mut Vec<usize>, lanes: &[usize]) {
    for &lane in lanes {
        if !all.contains(&lane) {
            all.push(lane);
        }
    }
}

/// Returns whether ego is in a common lane: all corners are in one lane, or front and rear are in lanes that
/// follow each other. It is not if a corner is in no lane, or if the corners are across lanes.
pub fn in_common_lane(map: &PlanningMap, corners: &CornerLanes) -> bool {
    let [front_left, rear_left, rear_right, front_right] = corners;
    if corners.iter().any(Vec::is_empty) {
        return false;
    }
    if front_left.iter().any(|lane| corners.iter().all(|lanes| lanes.contains(lane))) {
        return true;
    }
    let with_successors = |lanes: &[usize]| with_links(lanes, |lane| &map.lane(lane).successors);
    let with_predecessors = |lanes: &[usize]| with_links(lanes, |lane| &map.lane(lane).predecessors);
    let (after_left, after_right) = (with_successors(rear_left), with_successors(rear_right));
    let rear_is_connected = meet(rear_left, &after_right) || meet(rear_right, &after_left);
    let left_to_right = common(&with_predecessors(front_left), &after_right);
    let right_to_left = common(&with_predecessors(front_right), &after_left);
    rear_is_connected && meet(&left_to_right, &right_to_left)
}

/// Returns the lanes together with their links.
fn with_links<'m>(lanes: &[usize], links: impl Fn(usize) -> &'m Vec<usize>) -> Vec<usize> {
    let linked = lanes.iter().flat_map(|&lane| links(lane)).copied();
    lanes.iter().copied().chain(linked).collect()
}

fn common(a: &[usize], b: &[usize]) -> Vec<usize> {
    a.iter().copied().filter(|lane| b.contains(lane)).collect()
}

fn meet(a: &[usize], b: &[usize]) -> bool {
    a.iter().any(|lane| b.contains(lane))
}
