//! Who is where: vehicles by way, and who is coming to which way.

use super::following::Leader;
use super::network::{Beside, Network, Way};
use super::vehicle::Vehicle;

/// How far ahead drivers look along their path, metres.
pub(super) const SIGHT: f64 = 120.0;

/// Somebody on the way to a way, or on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coming {
    /// Index of the vehicle.
    pub(super) vehicle: usize,
    /// Position of its box centre from the beginning of the way, metres; negative before it.
    pub(super) at: f64,
    /// How many ways of its path come before.
    pub(super) ways: usize,
}

/// Made anew at every decision.
#[derive(Default)]
pub(super) struct Lists {
    /// Per way, those on it by arc length of the centre, and those who are leaving it for a neighbour.
    on: Vec<Vec<(f64, usize)>>,
    /// Per way, those whose path leads over it within sight.
    coming: Vec<Vec<Coming>>,
}

impl Lists {
    /// Fills the lists.
    pub(super) fn update(&mut self, network: &Network, vehicles: &[Vehicle]) {
        self.on.resize(network.ways.len(), Vec::new());
        self.coming.resize(network.ways.len(), Vec::new());
        self.on.iter_mut().for_each(Vec::clear);
        self.coming.iter_mut().for_each(Vec::clear);
        for (i, v) in vehicles.iter().enumerate() {
            self.on[v.path[0]].push((v.s, i));
            let way = &network.ways[v.path[0]];
            let from = v.change.and_then(|c| c.from);
            if let Some((from, s)) = from.and_then(|from| Some((from, leaving(way, from, v)?))) {
                self.on[from].push((s, i));
            } else if let Some((beside, s)) = protrudes(way, v) {
                self.on[beside].push((s, i));
            }
            let mut at = v.s;
            for (k, &w) in v.path.iter().enumerate() {
                self.coming[w].push(Coming { vehicle: i, at, ways: k });
                at -= network.ways[w].length;
                if at < -SIGHT {
                    break;
                }
            }
        }
        self.on.iter_mut().for_each(|list| list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))));
    }

    /// Those on a way, by arc length.
    pub(super) fn on(&self, way: usize) -> &[(f64, usize)] {
        &self.on[way]
    }

    /// Those who are coming to a way, and those on it.
    pub(super) fn coming(&self, way: usize) -> &[Coming] {
        &self.coming[way]
    }

    /// The first one on `way` beyond `s`, except `me`.
    pub(super) fn first_after(&self, way: usize, s: f64, me: usize) -> Option<(f64, usize)> {
        let list = &self.on[way];
        let i = list.partition_point(|e| e.0 <= s);
        list[i..].iter().copied().find(|e| e.1 != me)
    }

    /// The last one on `way` at `s` or before, except `me`.
    pub(super) fn last_before(&self, way: usize, s: f64, me: usize) -> Option<(f64, usize)> {
        let list = &self.on[way];
        let i = list.partition_point(|e| e.0 <= s);
        list[..i].iter().rev().copied().find(|e| e.1 != me)
    }

    /// Who drives ahead of somebody of that length at `s` of the first way of `path`.
    pub(super) fn leader(
        &self,
        network: &Network,
        vehicles: &[Vehicle],
        path: &[usize],
        (me, s, length): (usize, f64, f64),
    ) -> Option<(Leader, usize)> {
        let mut start = 0.0;
        let mut best: Option<(Leader, usize)> = None;
        let mut offer = |at: f64, i: usize| {
            let other = &vehicles[i];
            let gap = at - s - 0.5 * (length + other.body.length);
            if best.is_none_or(|b: (Leader, usize)| gap < b.0.gap) {
                best = Some((Leader { gap, speed: other.speed }, i));
            }
        };
        for (k, &w) in path.iter().enumerate() {
            let way = &network.ways[w];
            let from = if k == 0 { s } else { f64::NEG_INFINITY };
            let found = self.first_after(w, from, me);
            if let Some((at, i)) = found {
                offer(start + at, i);
            }
            // Those who have just turned off into a way that begins here are still partly in the way.
            for &(twin, shared) in &way.twins {
                for &(at, i) in &self.on[twin] {
                    if i != me && at > from && at - 0.5 * vehicles[i].body.length < shared {
                        offer(start + at, i);
                    }
                }
            }
            // On ways that join: who is nearer to the end goes first, and is followed.
            for conflict in way.conflicts.iter().filter(|c| c.joins) {
                let other = &network.ways[conflict.other];
                for &(at, i) in &self.on[conflict.other] {
                    let inside = at + 0.5 * vehicles[i].body.length > conflict.theirs[0];
                    let mirrored = way.length - (other.length - at);
                    if i != me && inside && mirrored > from {
                        offer(start + mirrored, i);
                    }
                }
            }
            start += way.length;
            if found.is_some() || start - s > SIGHT {
                break;
            }
        }
        best
    }
}

/// Where somebody who goes over from `from` still stands in its way, metres along it.
pub(super) fn leaving(way: &Way, from: usize, v: &Vehicle) -> Option<f64> {
    let on = |side: &[Beside], sign: f64| Some((*side.iter().find(|b| b.way == from)?, sign * v.offset));
    let (beside, towards) = on(&way.left, 1.0).or_else(|| on(&way.right, -1.0))?;
    let s = beside.across(v.s)?;
    (towards + 0.5 * v.body.width > way.half_width - 0.2).then_some(s)
}

/// The neighbour into which a vehicle reaches from its way, and where.
fn protrudes(way: &Way, v: &Vehicle) -> Option<(usize, f64)> {
    if v.offset.abs() + 0.5 * v.body.width < way.half_width + 0.1 {
        return None;
    }
    let beside = if v.offset > 0.0 { &way.left } else { &way.right };
    beside.iter().find_map(|b| Some((b.way, b.across(v.s)?)))
}
