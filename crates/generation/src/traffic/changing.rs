//! Lane changes: MOBIL, with an incentive to reach the lane that leads to the goal.
//!
//! A. Kesting, M. Treiber, D. Helbing, General lane-changing model MOBIL for car-following models,
//! Transportation Research Record 1999 (2007).

use super::following::{Leader, MAX_BRAKING};
use super::network::{Network, TrafficLane};
use super::occupancy::LaneOccupancy;
use super::routes::Routes;
use super::vehicle::Vehicle;

/// Braking, m/s², that a discretionary lane change may impose on the new follower.
const SAFE_BRAKING: f64 = 1.8;
/// Braking, m/s², that a mandatory lane change may impose on the new follower.
const SAFE_BRAKING_MANDATORY: f64 = 3.0;
/// Minimum gap to the new leader and follower in a discretionary change, metres.
const MIN_GAP: f64 = 4.0;
/// Minimum gap to the new leader and follower in a mandatory change, metres.
const MIN_GAP_MANDATORY: f64 = 2.0;
/// Minimum distance travelled in a discretionary change, metres.
const MIN_TRAVEL: f64 = 16.0;
/// Minimum distance travelled in a mandatory change, metres.
const MIN_TRAVEL_MANDATORY: f64 = 11.0;
/// Minimum speed for a discretionary change, m/s.
const MIN_SPEED: f64 = 4.0;
/// Minimum speed for a mandatory change, m/s.
const MIN_SPEED_MANDATORY: f64 = 2.5;
/// Minimum travel time that a better lane must save, s.
const MIN_TIME_SAVED: f64 = 1.5;
/// Incentive for the lane that leads to the goal, far from the end of the current lane, m/s².
const FAR_INCENTIVE: f64 = 0.3;
/// Incentive for the lane that leads to the goal, near the end of the current lane, m/s².
const NEAR_INCENTIVE: f64 = 3.0;
/// Distance before the end of the lane over which the incentive grows, metres.
const INCENTIVE_DISTANCE: f64 = 180.0;

/// Intention of a driver about lanes.
pub(super) enum LaneChangeIntent {
    /// Stays in the lane.
    Stay,
    /// Changes lanes now.
    Change { lane: usize },
    /// Must change but cannot: followers on that lane should leave room.
    LetIn { lane: usize, s: f64 },
}

/// Evaluates the adjacent lanes of a vehicle, given its acceleration on a free road and behind its current
/// leader.
pub(super) fn evaluate(
    (network, routes, occupancy): (&Network, &Routes, &LaneOccupancy),
    vehicles: &[Vehicle],
    me: usize,
    (free, behind): (f64, f64),
) -> LaneChangeIntent {
    let v = &vehicles[me];
    let lane = &network.lanes[v.path[0]];
    let stay_cost = cost_ahead(network, routes, v.goal, v.path[0]);
    let left = lane.length - v.s;
    let mut best: Option<(f64, usize)> = None;
    let mut wanted: Option<(usize, f64)> = None;
    for (beside, is_left) in lane.left.iter().map(|b| (b, true)).chain(lane.right.iter().map(|b| (b, false)))
    {
        let Some(s) = beside.across(v.s) else { continue };
        // If neither lane leads to the goal, one of the two may still be closer to the lane that does.
        let mandatory = stay_cost.is_infinite();
        let there = cost_ahead(network, routes, v.goal, beside.lane);
        let (here, there) = match (mandatory, there.is_infinite()) {
            (true, true) => (routes.cost(v.goal, v.path[0]), routes.cost(v.goal, beside.lane)),
            (false, true) => continue,
            (_, false) => (stay_cost, there),
        };
        let time_saved = if here.is_finite() { here - there } else { f64::INFINITY };
        let mandatory = mandatory && there.is_finite() && time_saved > 0.0;
        let near = (1.0 - (left.min(beside.remaining(v.s)) - 20.0) / INCENTIVE_DISTANCE).clamp(0.0, 1.0);
        let incentive = if time_saved > MIN_TIME_SAVED {
            FAR_INCENTIVE + (NEAR_INCENTIVE - FAR_INCENTIVE) * near
        } else if time_saved < -MIN_TIME_SAVED {
            -2.0
        } else {
            0.0
        };
        if mandatory {
            wanted = Some((beside.lane, s));
        }
        let min_speed = if mandatory { MIN_SPEED_MANDATORY } else { MIN_SPEED };
        // There must be enough lane left for the change.
        let needs = v.speed * v.driver.change_time * if mandatory { 0.45 } else { 0.9 };
        if v.speed < min_speed || beside.remaining(v.s) < needs || v.s < 3.0 {
            continue;
        }
        // A weak keep-right rule for slow traffic: a bias of 0.1 m/s² against changes to the left.
        let bias = if is_left { -0.1 } else { 0.0 };
        if let Some(gain) =
            gain((network, routes, occupancy), vehicles, me, (beside.lane, s, mandatory), (free, behind))
        {
            let gain = gain + incentive + bias;
            if gain > v.driver.threshold && best.as_ref().is_none_or(|b| gain > b.0) {
                best = Some((gain, beside.lane));
            }
        }
    }
    match (best, wanted) {
        (Some((_, lane)), _) => LaneChangeIntent::Change { lane },
        (None, Some((lane, s))) if left < 150.0 => LaneChangeIntent::LetIn { lane, s },
        _ => LaneChangeIntent::Stay,
    }
}

/// Returns the travel time in seconds from the beginning of a lane to the goal without a lane change on it;
/// infinite if the lane does not lead there.
fn cost_ahead(network: &Network, routes: &Routes, goal: usize, lane: usize) -> f64 {
    let TrafficLane { next, length, limit, .. } = &network.lanes[lane];
    if next.is_empty() {
        return routes.cost(goal, lane);
    }
    next.iter().map(|&n| routes.cost(goal, n)).fold(f64::INFINITY, f64::min) + length / limit
}

/// Returns MOBIL's incentive for a change, or `None` if the change is not safe.
fn gain(
    (network, routes, occupancy): (&Network, &Routes, &LaneOccupancy),
    vehicles: &[Vehicle],
    me: usize,
    (lane, s, mandatory): (usize, f64, bool),
    (free, behind): (f64, f64),
) -> Option<f64> {
    let v = &vehicles[me];
    let next = routes.next(network, v.goal, lane);
    let path = [lane, next.unwrap_or(lane)];
    let path = &path[..if next.is_some() { 2 } else { 1 }];
    let ahead = occupancy.leader(network, vehicles, path, (me, s, v.body.length)).map(|l| l.0);
    let min_gap = if mandatory { MIN_GAP_MANDATORY } else { MIN_GAP };
    // The change must be complete before the vehicle has to stop there.
    let travel = if mandatory { MIN_TRAVEL_MANDATORY } else { MIN_TRAVEL };
    if ahead.is_some_and(|l| l.gap < min_gap || l.gap + 2.5 * l.speed < travel) {
        return None;
    }
    let mine = ahead.map_or(f64::INFINITY, |l| v.driver.behind(v.speed, l)).min(free);
    let safe = if mandatory { SAFE_BRAKING_MANDATORY } else { SAFE_BRAKING };
    if mine < -safe {
        return None;
    }
    let mut others = 0.0;
    if let Some((at, j)) = follower(network, occupancy, lane, s, me) {
        let f = &vehicles[j];
        let gap = s - at - 0.5 * (v.body.length + f.body.length);
        if gap < min_gap * 0.8 {
            return None;
        }
        let after = f.driver.behind(f.speed, Leader { gap, speed: v.speed });
        if after < -safe {
            return None;
        }
        others = (after - f.acceleration).min(0.0);
    }
    Some(mine.max(-MAX_BRAKING) - free.min(behind).max(-MAX_BRAKING) + v.driver.politeness * others)
}

/// Returns the new follower on the other lane: on that lane, or on a preceding one (with a negative arc
/// length).
fn follower(
    network: &Network,
    occupancy: &LaneOccupancy,
    lane: usize,
    s: f64,
    me: usize,
) -> Option<(f64, usize)> {
    occupancy.last_before(lane, s, me).or_else(|| {
        let before = network.lanes[lane].before.iter().copied();
        let last = |index: usize| {
            let &(at, j) = occupancy.on(index).iter().rev().find(|e| e.1 != me)?;
            Some((at - network.lanes[index].length, j))
        };
        before.filter_map(last).max_by(|a, b| a.0.total_cmp(&b.0))
    })
}
