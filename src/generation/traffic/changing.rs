//! Lane changes: MOBIL, with a wish to be on the lane that leads to the goal.
//!
//! A. Kesting, M. Treiber, D. Helbing, General lane-changing model MOBIL for car-following models, Transportation Research Record 1999
//! (2007).

use super::following::{HARDEST, Leader};
use super::lists::Lists;
use super::network::{Beside, Network};
use super::routes::Routes;
use super::vehicle::Vehicle;

/// Braking that a lane change may force on the one behind, m/s²: usually, and where there is no other way.
const SAFE: f64 = 1.8;
const SAFE_IF_MUST: f64 = 3.0;
/// Room that must be left to both, metres.
const ROOM: (f64, f64) = (2.0, 4.0);
/// Way that a change takes at the least, metres: where there is no other way, and usually.
const TRAVEL: (f64, f64) = (11.0, 16.0);
/// Below this speed nobody changes lanes (there is no way to steer there), m/s; who must change does from a slower speed.
const SLOWEST: (f64, f64) = (4.0, 2.5);
/// Seconds of way that the better lane must save to be wished for.
const WORTH: f64 = 1.5;
/// The wish for the right lane grows from the first of these to the second as the end of the lane comes near, m/s².
const WISH: (f64, f64) = (0.3, 3.0);
/// How far before the end of the lane the wish begins to grow, in metres.
const BEGIN: f64 = 180.0;

/// A lane change that a driver has decided on.
pub(super) struct Decision {
    pub(super) way: usize,
    /// Arc length there, metres.
    pub(super) s: f64,
}

/// What a driver wants: to change now, or to be let in.
pub(super) enum Wish {
    /// Nothing.
    Stay,
    /// To change now.
    Change(Decision),
    /// Must change but can not: followers on that lane should leave room.
    LetIn { way: usize, s: f64 },
}

/// Weighs the lanes beside a vehicle. `acceleration` is what it decided where it is.
pub(super) fn weigh(
    (network, routes, lists): (&Network, &Routes, &Lists),
    vehicles: &[Vehicle],
    me: usize,
    acceleration: f64,
) -> Wish {
    let v = &vehicles[me];
    let way = &network.ways[v.path[0]];
    let along = way.length / way.limit;
    let keep = way.next.iter().map(|&n| routes.cost(v.goal, n)).fold(f64::INFINITY, f64::min) + along;
    let stays = if way.next.is_empty() { routes.cost(v.goal, v.path[0]) } else { keep };
    let left = way.length - v.s;
    let mut best: Option<(f64, Decision)> = None;
    let mut wanted: Option<(usize, f64)> = None;
    for (beside, is_left) in way.left.iter().map(|b| (b, true)).chain(way.right.iter().map(|b| (b, false))) {
        let Some(s) = beside.across(v.s) else { continue };
        let there = cost_beyond(network, routes, v.goal, beside);
        let saves = if there.is_finite() && stays.is_infinite() { f64::INFINITY } else { stays - there };
        let must = stays.is_infinite() && there.is_finite();
        if there.is_infinite() && !stays.is_infinite() {
            continue;
        }
        let near = (1.0 - (left.min(beside.left_of(v.s)) - 20.0) / BEGIN).clamp(0.0, 1.0);
        let wish = if saves > WORTH {
            WISH.0 + (WISH.1 - WISH.0) * near
        } else if saves < -WORTH {
            -2.0
        } else {
            0.0
        };
        if must {
            wanted = Some((beside.way, s));
        }
        let slowest = if must { SLOWEST.1 } else { SLOWEST.0 };
        // There must be way left to go over.
        let needs = v.speed * v.driver.change_time * if must { 0.45 } else { 0.9 };
        if v.speed < slowest || beside.left_of(v.s) < needs || v.s < 3.0 {
            continue;
        }
        // Keep-right rule of slow traffic is weak here; a bias of 0.1 m/s² against going left.
        let bias = if is_left { -0.1 } else { 0.0 };
        if let Some(gain) = gain(network, lists, vehicles, me, (beside.way, s, must), acceleration) {
            let gain = gain + wish + bias;
            if gain > v.driver.threshold && best.as_ref().is_none_or(|b| gain > b.0) {
                best = Some((gain, Decision { way: beside.way, s }));
            }
        }
    }
    match (best, wanted) {
        (Some((_, decision)), _) => Wish::Change(decision),
        (None, Some((way, s))) if left < 150.0 => Wish::LetIn { way, s },
        _ => Wish::Stay,
    }
}

fn cost_beyond(network: &Network, routes: &Routes, goal: usize, beside: &Beside) -> f64 {
    let way = &network.ways[beside.way];
    if way.next.is_empty() {
        return routes.cost(goal, beside.way);
    }
    let next = way.next.iter().map(|&n| routes.cost(goal, n)).fold(f64::INFINITY, f64::min);
    next + way.length / way.limit
}

/// What a change brings (MOBIL's incentive), or `None` where it is not safe.
fn gain(
    network: &Network,
    lists: &Lists,
    vehicles: &[Vehicle],
    me: usize,
    (way, s, must): (usize, f64, bool),
    acceleration: f64,
) -> Option<f64> {
    let v = &vehicles[me];
    let path = [way].into_iter().chain(network.ways[way].next.first().copied()).collect::<Vec<_>>();
    let ahead = lists.leader(network, vehicles, &path, (me, s, v.body.length)).map(|l| l.0);
    let room = if must { ROOM.0 } else { ROOM.1 };
    // One must be over before one has to stop there.
    let travel = if must { TRAVEL.0 } else { TRAVEL.1 };
    if ahead.is_some_and(|l| l.gap < room || l.gap + 2.5 * l.speed < travel) {
        return None;
    }
    let mine = ahead
        .map_or(f64::INFINITY, |l| v.driver.behind(v.speed, l))
        .min(v.driver.free(v.speed, 1.2 * v.speed + 2.0));
    let safe = if must { SAFE_IF_MUST } else { SAFE };
    if mine < -safe {
        return None;
    }
    let mut others = 0.0;
    if let Some((at, j)) = follower(network, lists, way, s, me) {
        let f = &vehicles[j];
        let gap = s - at - 0.5 * (v.body.length + f.body.length);
        if gap < room * 0.8 {
            return None;
        }
        let after = f.driver.behind(f.speed, Leader { gap, speed: v.speed });
        if after < -safe {
            return None;
        }
        others = (after - f.acceleration).min(0.0);
    }
    Some(mine.max(-HARDEST) - acceleration + v.driver.politeness * others)
}

/// Who would be behind on the other way: on it, or on the one before it (at a negative arc length).
fn follower(network: &Network, lists: &Lists, way: usize, s: f64, me: usize) -> Option<(f64, usize)> {
    lists.last_before(way, s, me).or_else(|| {
        let before = network.ways[way].before.iter().copied();
        let last = |w: usize| {
            let &(at, j) = lists.on(w).iter().rev().find(|e| e.1 != me)?;
            Some((at - network.ways[w].length, j))
        };
        before.filter_map(last).max_by(|a, b| a.0.total_cmp(&b.0))
    })
}
