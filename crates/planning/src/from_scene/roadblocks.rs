//! Groups of lanes in place of the roadblocks of nuPlan.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_scene::{Lane, LaneKind};

use crate::map::Roadblock;

/// Roadblocks, and the roadblock of each lane.
pub(super) struct Roadblocks {
    pub(super) list: Vec<Roadblock>,
    pub(super) of_lane: Vec<usize>,
}

/// The group of a lane, or a connector, by the index of one of its lanes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Group {
    Lanes(usize),
    Connector(usize),
}

/// Groups of the lanes before and after a connector.
type Ends = (BTreeSet<Group>, BTreeSet<Group>);

/// Groups lanes: lanes that are connected by links to neighbours of the same direction; connectors between
/// the same groups. Without lanes between intersections, connectors are grouped as lanes are.
pub(super) fn roadblocks(lanes: &[Lane]) -> Roadblocks {
    let has_lanes = lanes.iter().any(|lane| lane.kind == LaneKind::Lane);
    let is_connector = |lane: usize| has_lanes && lanes[lane].kind == LaneKind::Connector;
    let neighbors = connected_neighbors(lanes, &is_connector);
    let group = |lane: usize| {
        if is_connector(lane) { Group::Connector(lane) } else { Group::Lanes(neighbors[lane]) }
    };
    let mut first_between: BTreeMap<Ends, usize> = BTreeMap::new();
    let representative = |lane: usize| {
        if !is_connector(lane) {
            return neighbors[lane];
        }
        let groups = |links: &[usize]| -> BTreeSet<Group> { links.iter().map(|&link| group(link)).collect() };
        let ends = (groups(&lanes[lane].predecessors), groups(&lanes[lane].successors));
        if ends.0.is_empty() || ends.1.is_empty() { lane } else { *first_between.entry(ends).or_insert(lane) }
    };
    numbered(lanes, (0..lanes.len()).map(representative).collect())
}

/// Returns the smallest index among the lanes that are connected to each lane by links to neighbours.
/// Connectors stay on their own.
fn connected_neighbors(lanes: &[Lane], is_connector: &impl Fn(usize) -> bool) -> Vec<usize> {
    let mut parents: Vec<usize> = (0..lanes.len()).collect();
    for (i, lane) in lanes.iter().enumerate() {
        for neighbor in lane.left.iter().chain(&lane.right) {
            if neighbor.lane < lanes.len() && !is_connector(i) && !is_connector(neighbor.lane) {
                let (a, b) = (root(&parents, i), root(&parents, neighbor.lane));
                parents[a.max(b)] = a.min(b);
            }
        }
    }
    (0..lanes.len()).map(|lane| root(&parents, lane)).collect()
}

fn root(parents: &[usize], mut lane: usize) -> usize {
    while parents[lane] != lane {
        lane = parents[lane];
    }
    lane
}

/// Numbers the groups in the order of their first lanes, which name them.
fn numbered(lanes: &[Lane], representatives: Vec<usize>) -> Roadblocks {
    let first_lanes: BTreeSet<usize> = representatives.iter().copied().collect();
    let numbers: BTreeMap<usize, usize> =
        first_lanes.iter().enumerate().map(|(i, &lane)| (lane, i)).collect();
    let name = |&lane: &usize| Roadblock { id: format!("roadblock of {}", lanes[lane].id), area: None };
    Roadblocks {
        list: first_lanes.iter().map(name).collect(),
        of_lane: representatives.iter().map(|lane| numbers[lane]).collect(),
    }
}
