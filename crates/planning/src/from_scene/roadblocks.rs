//! Groups of lanes in place of the roadblocks of nuPlan.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_scene::{Lane, LaneKind};

use crate::map::Roadblock;
use crate::search::led_to;

use super::pieces::{Pieces, branch};

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

/// Groups lanes: lanes that are side by side, none of which leads to another or is a branch of it; connectors
/// between the same groups. Without lanes between intersections, connectors are grouped as lanes are.
pub(super) fn roadblocks(pieces: &Pieces) -> Roadblocks {
    let lanes = &pieces.lanes;
    let has_lanes = lanes.iter().any(|lane| lane.kind == LaneKind::Lane);
    let is_connector = |lane: usize| has_lanes && lanes[lane].kind == LaneKind::Connector;
    let parallel = parallel_lanes(pieces);
    let group = |lane: usize| {
        if is_connector(lane) { Group::Connector(lane) } else { Group::Lanes(parallel[lane]) }
    };
    let mut first_between: BTreeMap<Ends, usize> = BTreeMap::new();
    let representative = |lane: usize| {
        if !is_connector(lane) {
            return parallel[lane];
        }
        let groups = |links: &[usize]| -> BTreeSet<Group> { links.iter().map(|&link| group(link)).collect() };
        let ends = (groups(&lanes[lane].predecessors), groups(&lanes[lane].successors));
        if ends.0.is_empty() || ends.1.is_empty() { lane } else { *first_between.entry(ends).or_insert(lane) }
    };
    numbered(lanes, (0..lanes.len()).map(representative).collect())
}

/// Returns the smallest index among the lanes side by side with each lane. The most parallel lanes are joined
/// first, and only if no lane of one group leads to a lane of the other or is a branch of it.
fn parallel_lanes(pieces: &Pieces) -> Vec<usize> {
    let lanes = &pieces.lanes;
    let next = |lane| led_to(lane, |lane| &lanes[lane].successors, |lane| lanes[lane].baseline.length());
    let next: Vec<BTreeMap<usize, Vec<usize>>> = (0..lanes.len()).map(next).collect();
    let excludes = |a: usize, b: usize| {
        branch(&lanes[a], &lanes[b]) || next[a].contains_key(&b) || next[b].contains_key(&a)
    };
    let mut groups: Vec<usize> = (0..lanes.len()).collect();
    let mut members: Vec<Vec<usize>> = groups.iter().map(|&lane| vec![lane]).collect();
    let mut pairs = pieces.beside.clone();
    pairs.sort_by(|a, b| b.2.total_cmp(&a.2).then((a.0, a.1).cmp(&(b.0, b.1))));
    for (a, b, _) in pairs {
        let (a, b) = (groups[a].min(groups[b]), groups[a].max(groups[b]));
        if a == b || members[a].iter().any(|&lane| members[b].iter().any(|&other| excludes(lane, other))) {
            continue;
        }
        let joined = std::mem::take(&mut members[b]);
        joined.iter().for_each(|&lane| groups[lane] = a);
        members[a].extend(joined);
    }
    groups
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
