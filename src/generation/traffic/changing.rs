//! Lane changes: MOBIL, with a wish to be on the lane that leads to the goal.
//!
//! A. Kesting, M. Treiber, D. Helbing, General lane-changing model MOBIL for car-following models, Transportation Research Record 1999
//! (2007).

use super::following::{HARDEST, Leader};
use super::lists::Lists;
use super::network::{Network, Way};
use super::routes::Routes;
use super::vehicle::Vehicle;

/// Braking that a lane change may force on the one behind, m/s²: usually, and where there is no other way.
const SAFE: f64 = 1.8;
const SAFE_IF_MUST: f64 = 3.0;
/// Room that must be left to both, metres. Of this and the next pairs, the first is for those who must change.
const ROOM: (f64, f64) = (2.0, 4.0);
/// Way that a change takes at the least, metres: where there is no other way, and usually.
const TRAVEL: (f64, f64) = (11.0, 16.0);
/// Below these speeds nobody changes lanes, m/s.
const SLOWEST: (f64, f64) = (2.5, 4.0);
/// Seconds of way that the better lane must save to be wished for.
const WORTH: f64 = 1.5;
/// The wish for the right lane grows from the first of these to the second as the end of the lane comes near, m/s².
const WISH: (f64, f64) = (0.3, 3.0);
/// How far before the end of the lane the wish begins to grow, in metres.
const BEGIN: f64 = 180.0;

/// What a driver wants: to change now, or to be let in.
pub(super) enum Wish {
    /// Nothing.
    Stay,
    /// To change now.
    Change { way: usize },
    /// Must change but can not: followers on that lane should leave room.
    LetIn { way: usize, s: f64 },
}

/// Weighs the lanes beside a vehicle, by its acceleration on a free road and behind its leader where it is.
pub(super) fn weigh(
    (network, routes, lists): (&Network, &Routes, &Lists),
    vehicles: &[Vehicle],
    me: usize,
    (free, behind): (f64, f64),
) -> Wish {
    let v = &vehicles[me];
    let way = &network.ways[v.path[0]];
    let stays = cost_ahead(network, routes, v.goal, v.path[0]);
    let left = way.length - v.s;
    let mut best: Option<(f64, usize)> = None;
    let mut wanted: Option<(usize, f64)> = None;
    for (beside, is_left) in way.left.iter().map(|b| (b, true)).chain(way.right.iter().map(|b| (b, false))) {
        let Some(s) = beside.across(v.s) else { continue };
        // Where neither lane leads to the goal, one of the two may still be nearer to the one that does.
        let must = stays.is_infinite();
        let there = cost_ahead(network, routes, v.goal, beside.way);
        let (here, there) = match (must, there.is_infinite()) {
            (true, true) => (routes.cost(v.goal, v.path[0]), routes.cost(v.goal, beside.way)),
            (false, true) => continue,
            (_, false) => (stays, there),
        };
        let saves = if here.is_finite() { here - there } else { f64::INFINITY };
        let must = must && there.is_finite() && saves > 0.0;
        let near = (1.0 - (left.min(beside.remaining(v.s)) - 20.0) / BEGIN).clamp(0.0, 1.0);
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
        let slowest = if must { SLOWEST.0 } else { SLOWEST.1 };
        // There must be way left to go over.
        let needs = v.speed * v.driver.change_time * if must { 0.45 } else { 0.9 };
        if v.speed < slowest || beside.remaining(v.s) < needs || v.s < 3.0 {
            continue;
        }
        // Keep-right rule of slow traffic is weak here; a bias of 0.1 m/s² against going left.
        let bias = if is_left { -0.1 } else { 0.0 };
        if let Some(gain) =
            gain((network, routes, lists), vehicles, me, (beside.way, s, must), (free, behind))
        {
            let gain = gain + wish + bias;
            if gain > v.driver.threshold && best.as_ref().is_none_or(|b| gain > b.0) {
                best = Some((gain, beside.way));
            }
        }
    }
    match (best, wanted) {
        (Some((_, way)), _) => Wish::Change { way },
        (None, Some((way, s))) if left < 150.0 => Wish::LetIn { way, s },
        _ => Wish::Stay,
    }
}

/// Seconds from the beginning of a way to the goal without a lane change on it; infinite where it does not lead there.
fn cost_ahead(network: &Network, routes: &Routes, goal: usize, way: usize) -> f64 {
    let Way { next, length, limit, .. } = &network.ways[way];
    if next.is_empty() {
        return routes.cost(goal, way);
    }
    next.iter().map(|&n| routes.cost(goal, n)).fold(f64::INFINITY, f64::min) + length / limit
}

/// What a change brings (MOBIL's incentive), or `None` where it is not safe.
fn gain(
    (network, routes, lists): (&Network, &Routes, &Lists),
    vehicles: &[Vehicle],
    me: usize,
    (way, s, must): (usize, f64, bool),
    (free, behind): (f64, f64),
) -> Option<f64> {
    let v = &vehicles[me];
    let next = routes.next(network, v.goal, way);
    let path = [way, next.unwrap_or(way)];
    let path = &path[..if next.is_some() { 2 } else { 1 }];
    let ahead = lists.leader(network, vehicles, path, (me, s, v.body.length)).map(|l| l.0);
    let room = if must { ROOM.0 } else { ROOM.1 };
    // One must be over before one has to stop there.
    let travel = if must { TRAVEL.0 } else { TRAVEL.1 };
    if ahead.is_some_and(|l| l.gap < room || l.gap + 2.5 * l.speed < travel) {
        return None;
    }
    let mine = ahead.map_or(f64::INFINITY, |l| v.driver.behind(v.speed, l)).min(free);
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
    Some(mine.max(-HARDEST) - free.min(behind).max(-HARDEST) + v.driver.politeness * others)
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
