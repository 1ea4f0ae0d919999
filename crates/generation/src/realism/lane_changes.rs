//! Counting of lane changes.

use reactsim_geometry::wrap;
use reactsim_scene::{FRAMES, LaneHit, Road, Scenario};

use super::lanes::{self, MIN_ADJACENT_SPACING};

/// Offset from the lane centre, metres, within which a vehicle has settled in the lane.
const SETTLED_OFFSET: f64 = 0.9;
/// Distance between lane centres, metres, up to which lanes are adjacent.
const MAX_ADJACENT_SPACING: f64 = 5.0;
/// Maximum duration of a lane change, frames.
const MAX_CHANGE_FRAMES: usize = 60;
/// Number of frames for which a vehicle must stay in its new lane, unless its track ends earlier.
const MIN_STAY_FRAMES: usize = 10;
/// Heading change, radians (15°), above which the vehicle instead takes a lane of its choice out of a
/// junction.
const MAX_TURN: f64 = 0.26;
/// Interval between two lane look-ups, frames.
const FRAME_STEP: usize = 2;
/// Maximum number of successor links between lanes that count as the same lane.
const MAX_LINKS: usize = 3;

/// Lane changes and distance of one vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LaneUse {
    /// Number of lane changes.
    pub(super) changes: u32,
    /// Distance driven, metres.
    pub(super) metres: f64,
}

/// State of a vehicle at a frame at which it has settled in a lane.
struct LaneSample {
    frame: usize,
    /// Heading of the vehicle, radians.
    heading: f64,
    /// Index of the lane.
    lane: usize,
    /// Lanes along the vehicle, including its own, with the signed offset of the vehicle from each, metres.
    alongside: Vec<(usize, f64)>,
}

/// Counts the lane changes of a vehicle. In a lane change, a vehicle leaves its lane and settles in another
/// one that runs alongside from before the change until after it, that is not reachable without a change,
/// and in which the vehicle then stays. Diverging lanes, overlapping connectors and wide turns at junctions
/// therefore do not count.
pub(super) fn lane_use(
    scenario: &Scenario,
    road: &Road<'_>,
    agent: usize,
    hits: &mut Vec<LaneHit>,
) -> LaneUse {
    let mut result = LaneUse::default();
    let mut settled: Vec<LaneSample> = Vec::new();
    let mut last = None;
    for frame in (0..FRAMES).step_by(FRAME_STEP) {
        let Some(state) = scenario.logged_at(agent, frame) else { continue };
        lanes::lanes_along(road, &state, MAX_ADJACENT_SPACING + SETTLED_OFFSET, hits);
        let nearest = hits.iter().min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance));
        let Some(nearest) = nearest else {
            last = None;
            continue;
        };
        if let Some(before) = last.replace(state.position()) {
            result.metres += (state.position() - before).norm();
        }
        if nearest.projection.distance < SETTLED_OFFSET {
            let alongside = hits.iter().map(|h| (h.lane, h.projection.offset)).collect();
            settled.push(LaneSample { frame, heading: state.heading, lane: nearest.lane, alongside });
        }
    }
    for i in 1..settled.len() {
        if is_change(road, &settled[i - 1], &settled[i]) && stays_in_lane(road, &settled[i..]) {
            result.changes += 1;
        }
    }
    result
}

fn is_change(road: &Road<'_>, before: &LaneSample, now: &LaneSample) -> bool {
    let turns = wrap(now.heading - before.heading).abs() > MAX_TURN;
    if now.frame - before.frame > MAX_CHANGE_FRAMES || turns || leads_to(road, before.lane, now.lane) {
        return false;
    }
    let apart = |at: &LaneSample, (_, offset): (usize, f64), from: usize| {
        let own = at.alongside.iter().find(|b| b.0 == from).map_or(0.0, |b| b.1);
        (MIN_ADJACENT_SPACING..MAX_ADJACENT_SPACING).contains(&(offset - own).abs())
    };
    let came_beside =
        before.alongside.iter().any(|&b| apart(before, b, before.lane) && leads_to(road, b.0, now.lane));
    let left_beside =
        now.alongside.iter().any(|&b| apart(now, b, now.lane) && leads_to(road, before.lane, b.0));
    came_beside && left_beside
}

/// Whether the vehicle stays in the lane in which it has settled first.
fn stays_in_lane(road: &Road<'_>, settled: &[LaneSample]) -> bool {
    let first = &settled[0];
    let after = settled.iter().take_while(|s| s.frame <= first.frame + MIN_STAY_FRAMES);
    after.into_iter().all(|s| leads_to(road, first.lane, s.lane))
}

/// Whether `to` is the same lane as `from` or follows it within a few successor links.
fn leads_to(road: &Road<'_>, from: usize, to: usize) -> bool {
    let mut reached = vec![from];
    for _ in 0..MAX_LINKS {
        if reached.contains(&to) {
            return true;
        }
        reached = reached.iter().flat_map(|&l| road.lane(l).successors.iter().copied()).collect();
    }
    reached.contains(&to)
}
