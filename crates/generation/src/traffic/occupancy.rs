//! Vehicles by lane: on each lane, and approaching it.

use super::following::Leader;
use super::network::{AdjacentLane, Network, TrafficLane};
use super::vehicle::Vehicle;

/// Distance that drivers look ahead along their path, metres.
pub(super) const SIGHT_DISTANCE: f64 = 120.0;

/// A vehicle that approaches a lane or is on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ApproachingVehicle {
    /// Index of the vehicle.
    pub(super) vehicle: usize,
    /// Position of its box centre from the beginning of the lane, metres; negative before it.
    pub(super) at: f64,
    /// Number of lanes on its path before this one.
    pub(super) lanes_before: usize,
}

/// Lists of vehicles per lane, rebuilt at every decision.
#[derive(Default)]
pub(super) struct LaneOccupancy {
    /// Per lane: arc length of the centre and index of the vehicles on it, including those that are leaving
    /// it for an adjacent lane.
    on: Vec<Vec<(f64, usize)>>,
    /// Per lane: vehicles within sight whose path uses it.
    approaching: Vec<Vec<ApproachingVehicle>>,
}

impl LaneOccupancy {
    pub(super) fn update(&mut self, network: &Network, vehicles: &[Vehicle]) {
        self.on.resize(network.lanes.len(), Vec::new());
        self.approaching.resize(network.lanes.len(), Vec::new());
        self.on.iter_mut().for_each(Vec::clear);
        self.approaching.iter_mut().for_each(Vec::clear);
        for (i, v) in vehicles.iter().enumerate() {
            self.on[v.path[0]].push((v.s, i));
            let lane = &network.lanes[v.path[0]];
            let from = v.change.and_then(|c| c.from);
            if let Some((from, s)) = from.and_then(|from| Some((from, leaving(lane, from, v)?))) {
                self.on[from].push((s, i));
            } else if let Some((beside, s)) = protrusion(lane, v) {
                self.on[beside].push((s, i));
            }
            let mut at = v.s;
            for (k, &index) in v.path.iter().enumerate() {
                self.approaching[index].push(ApproachingVehicle { vehicle: i, at, lanes_before: k });
                at -= network.lanes[index].length;
                if at < -SIGHT_DISTANCE {
                    break;
                }
            }
        }
        self.on.iter_mut().for_each(|list| list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))));
    }

    /// Returns the vehicles on a lane, by arc length.
    pub(super) fn on(&self, lane: usize) -> &[(f64, usize)] {
        &self.on[lane]
    }

    /// Returns the vehicles on a lane or approaching it.
    pub(super) fn approaching(&self, lane: usize) -> &[ApproachingVehicle] {
        &self.approaching[lane]
    }

    /// Returns the first vehicle on `lane` beyond `s`, except `me`.
    pub(super) fn first_after(&self, lane: usize, s: f64, me: usize) -> Option<(f64, usize)> {
        let list = &self.on[lane];
        let i = list.partition_point(|e| e.0 <= s);
        list[i..].iter().copied().find(|e| e.1 != me)
    }

    /// Returns the last vehicle on `lane` at `s` or before, except `me`.
    pub(super) fn last_before(&self, lane: usize, s: f64, me: usize) -> Option<(f64, usize)> {
        let list = &self.on[lane];
        let i = list.partition_point(|e| e.0 <= s);
        list[..i].iter().rev().copied().find(|e| e.1 != me)
    }

    /// Returns the leader of a vehicle of this length at `s` of the first lane of `path`.
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
        for (k, &index) in path.iter().enumerate() {
            let lane = &network.lanes[index];
            let from = if k == 0 { s } else { f64::NEG_INFINITY };
            let found = self.first_after(index, from, me);
            if let Some((at, i)) = found {
                offer(start + at, i);
            }
            // Vehicles that have just turned into a lane that begins here still block this lane in part.
            for &(twin, shared) in &lane.twins {
                for &(at, i) in &self.on[twin] {
                    if i != me && at > from && at - 0.5 * vehicles[i].body.length < shared {
                        offer(start + at, i);
                    }
                }
            }
            // On joining lanes the vehicle closer to the end goes first, and the other one follows it.
            for conflict in lane.conflicts.iter().filter(|c| c.joins) {
                let other = &network.lanes[conflict.other];
                for &(at, i) in &self.on[conflict.other] {
                    let inside = at + 0.5 * vehicles[i].body.length > conflict.theirs[0];
                    let mirrored = lane.length - (other.length - at);
                    if i != me && inside && mirrored > from {
                        offer(start + mirrored, i);
                    }
                }
            }
            start += lane.length;
            if found.is_some() || start - s > SIGHT_DISTANCE {
                break;
            }
        }
        best
    }
}

/// Returns the arc length on lane `from`, metres, of a vehicle that is leaving that lane but still blocks
/// it.
pub(super) fn leaving(lane: &TrafficLane, from: usize, v: &Vehicle) -> Option<f64> {
    let on =
        |side: &[AdjacentLane], sign: f64| Some((*side.iter().find(|b| b.lane == from)?, sign * v.offset));
    let (beside, towards) = on(&lane.left, 1.0).or_else(|| on(&lane.right, -1.0))?;
    let s = beside.across(v.s)?;
    (towards + 0.5 * v.body.width > lane.half_width - 0.2).then_some(s)
}

/// Returns the adjacent lane into which a vehicle protrudes, and the arc length there.
fn protrusion(lane: &TrafficLane, v: &Vehicle) -> Option<(usize, f64)> {
    if v.offset.abs() + 0.5 * v.body.width < lane.half_width + 0.1 {
        return None;
    }
    let beside = if v.offset > 0.0 { &lane.left } else { &lane.right };
    beside.iter().find_map(|b| Some((b.lane, b.across(v.s)?)))
}
