//! How often vehicles change lanes.

use super::lanes::{self, BESIDE};
use crate::geometry::wrap;
use crate::scene::{FRAMES, LaneHit, Road, Scenario};

/// A vehicle has settled in a lane this close to its centre, metres.
const SETTLED: f64 = 0.9;
/// Lanes farther apart than this are not next to each other, metres.
const NEXT: f64 = 5.0;
/// A change takes no longer than this, frames.
const LONGEST: usize = 60;
/// After a change a vehicle stays in its lane for so many frames, or to the end of its track.
const STAYS: usize = 10;
/// A vehicle that turns by more than this meanwhile takes a lane of its choice out of a junction, radians (15°).
const TURNS: f64 = 0.26;
/// Every so many frames the lane is looked for.
const STEP: usize = 2;
/// So many lanes one after the other are the same lane.
const CHAIN: usize = 3;

/// What a vehicle does in lanes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct InLanes {
    /// Changes of lane.
    pub(super) changes: u32,
    /// Way driven, metres.
    pub(super) metres: f64,
}

/// A frame at which a vehicle has settled in a lane.
struct Settled {
    frame: usize,
    /// Heading of the vehicle, radians.
    heading: f64,
    /// Index of the lane.
    lane: usize,
    /// The lanes along the vehicle, that one among them, with the signed offset of the vehicle, metres.
    beside: Vec<(usize, f64)>,
}

/// Counts the changes of lane of a vehicle. It leaves a lane to settle in one that ran beside it from before the change until after it, that
/// can not be come to without a change, and stays there. So neither lanes that part nor connectors that overlap count, nor wide turns at
/// junctions.
pub(super) fn in_lanes(
    scenario: &Scenario,
    road: &Road<'_>,
    agent: usize,
    hits: &mut Vec<LaneHit>,
) -> InLanes {
    let mut result = InLanes::default();
    let mut settled: Vec<Settled> = Vec::new();
    let mut last = None;
    for frame in (0..FRAMES).step_by(STEP) {
        let Some(state) = scenario.logged_at(agent, frame) else { continue };
        lanes::lanes_along(road, &state, NEXT + SETTLED, hits);
        let nearest = hits.iter().min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance));
        let Some(nearest) = nearest else {
            last = None;
            continue;
        };
        if let Some(before) = last.replace(state.position()) {
            result.metres += (state.position() - before).norm();
        }
        if nearest.projection.distance < SETTLED {
            let beside = hits.iter().map(|h| (h.lane, h.projection.offset)).collect();
            settled.push(Settled { frame, heading: state.heading, lane: nearest.lane, beside });
        }
    }
    for i in 1..settled.len() {
        if is_change(road, &settled[i - 1], &settled[i]) && stays(road, &settled[i..]) {
            result.changes += 1;
        }
    }
    result
}

fn is_change(road: &Road<'_>, before: &Settled, now: &Settled) -> bool {
    let turns = wrap(now.heading - before.heading).abs() > TURNS;
    if now.frame - before.frame > LONGEST || turns || leads(road, before.lane, now.lane) {
        return false;
    }
    let apart = |at: &Settled, (_, offset): (usize, f64), from: usize| {
        let own = at.beside.iter().find(|b| b.0 == from).map_or(0.0, |b| b.1);
        (BESIDE..NEXT).contains(&(offset - own).abs())
    };
    let came_beside =
        before.beside.iter().any(|&b| apart(before, b, before.lane) && leads(road, b.0, now.lane));
    let left_beside = now.beside.iter().any(|&b| apart(now, b, now.lane) && leads(road, before.lane, b.0));
    came_beside && left_beside
}

/// Whether the vehicle keeps to the lane that it has settled in first.
fn stays(road: &Road<'_>, settled: &[Settled]) -> bool {
    let first = &settled[0];
    let after = settled.iter().take_while(|s| s.frame <= first.frame + STAYS);
    after.into_iter().all(|s| leads(road, first.lane, s.lane))
}

/// Whether one lane goes over into the other, or is the same.
fn leads(road: &Road<'_>, from: usize, to: usize) -> bool {
    let mut reached = vec![from];
    for _ in 0..CHAIN {
        if reached.contains(&to) {
            return true;
        }
        reached = reached.iter().flat_map(|&l| road.lane(l).successors.iter().copied()).collect();
    }
    reached.contains(&to)
}
