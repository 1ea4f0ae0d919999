//! The lanes that a vehicle drives along in maps whose lanes overlap.

use std::collections::BTreeMap;

use reactsim_geometry::{Bounds, Vec2, wrap};
use reactsim_scene::LANE_HALF_WIDTH;

use crate::search::led_to;
use crate::{EgoState, PlanningMap};

/// Largest distance in metres between the centre of a vehicle and the centre line of its lane: one or two
/// lanes beside. Long vehicles cut corners.
const MAX_DISTANCE: f64 = 6.0;
/// Cost of a sample at which the vehicle is another half-width aside of its lane, in changes of lanes: 20
/// such samples, two seconds, are as unlikely as a change.
const ASIDE: f64 = 0.05;
/// Cost of a sample per radian between the vehicle and its lane, in changes of lanes.
const TURNED: f64 = 0.01;

/// A lane of a vehicle at one sample, with the cheapest way to it.
struct Candidate {
    lane: usize,
    cost: f64,
    /// Index among the candidates of the sample before.
    parent: Option<usize>,
}

/// Returns the sequence of lanes that a vehicle drives along, with the lanes between lanes that are linked
/// through others: the one with the fewest changes to lanes that no link leads to, and among equals the one
/// nearest to the vehicle. Where lanes fork, the later samples decide. Empty if the vehicle is along no lane.
pub(super) fn driven_lanes(map: &PlanningMap, states: &[EgoState], centers: &[Vec2]) -> Vec<usize> {
    // The lanes to which lanes lead, with the lanes between.
    let mut ways: BTreeMap<usize, BTreeMap<usize, Vec<usize>>> = BTreeMap::new();
    let mut samples: Vec<Vec<Candidate>> = Vec::new();
    for (state, &center) in states.iter().zip(centers) {
        let near = lanes_along(map, center, state.heading);
        if near.is_empty() {
            continue;
        }
        for &(lane, _) in &near {
            let length = |lane: usize| map.lane(lane).baseline.length();
            ways.entry(lane).or_insert_with(|| led_to(lane, |lane| &map.lane(lane).successors, length));
        }
        let before = samples.last().map_or(&[][..], Vec::as_slice);
        let next = near.into_iter().map(|(lane, cost)| cheapest(before, &ways, lane, cost)).collect();
        samples.push(next);
    }
    sequence(&samples, &ways)
}

/// Returns the lanes along a vehicle, in map order, with the cost of being there.
fn lanes_along(map: &PlanningMap, center: Vec2, heading: f64) -> Vec<(usize, f64)> {
    let lanes = map.lanes_within(&Bounds::around(center, MAX_DISTANCE)).into_iter();
    let along = lanes.filter_map(|lane| {
        let baseline = &map.lane(lane).baseline;
        let projection = baseline.project(center);
        let angle = wrap(baseline.heading(projection.segment) - heading).abs();
        if projection.distance > MAX_DISTANCE || angle > std::f64::consts::FRAC_PI_2 {
            return None;
        }
        let aside = (projection.distance - LANE_HALF_WIDTH).max(0.0) / LANE_HALF_WIDTH;
        Some((lane, ASIDE * aside + TURNED * angle))
    });
    along.collect()
}

/// Returns the candidate `lane` after the cheapest candidate of the sample before, the first one among
/// equals.
fn cheapest(
    before: &[Candidate],
    ways: &BTreeMap<usize, BTreeMap<usize, Vec<usize>>>,
    lane: usize,
    cost: f64,
) -> Candidate {
    let after = |other: &Candidate| {
        let is_linked = other.lane == lane || ways[&other.lane].contains_key(&lane);
        other.cost + if is_linked { 0.0 } else { 1.0 }
    };
    let parent = (0..before.len()).min_by(|&a, &b| after(&before[a]).total_cmp(&after(&before[b])));
    Candidate { lane, cost: cost + parent.map_or(0.0, |parent| after(&before[parent])), parent }
}

/// Returns the lanes of the cheapest sequence of candidates, each once, with the lanes between them.
fn sequence(samples: &[Vec<Candidate>], ways: &BTreeMap<usize, BTreeMap<usize, Vec<usize>>>) -> Vec<usize> {
    let Some(last) = samples.last() else { return Vec::new() };
    let mut at = (0..last.len()).min_by(|&a, &b| last[a].cost.total_cmp(&last[b].cost));
    let mut lanes: Vec<usize> = Vec::new();
    for candidates in samples.iter().rev() {
        let Some(candidate) = at.map(|at| &candidates[at]) else { break };
        match lanes.last() {
            Some(&next) if next == candidate.lane => {}
            Some(next) => {
                let between = ways[&candidate.lane].get(next).into_iter().flatten().rev();
                lanes.extend(between.chain([&candidate.lane]));
            }
            None => lanes.push(candidate.lane),
        }
        at = candidate.parent;
    }
    lanes.reverse();
    lanes
}
