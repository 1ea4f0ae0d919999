//! Where ways cross or join, and who goes first there.

use super::super::super::{Layout, RightOfWay};
use super::{Network, Way};
use crate::geometry::Bounds;

/// Centre lines that come closer than this are in conflict, metres: two vehicles of usual width and some room.
const VEHICLES: f64 = 2.3;
/// The same where ways join and vehicles would be side by side for long.
const SIDE_BY_SIDE: f64 = 2.8;
/// The same where one of them is for bicycles.
const BICYCLE: f64 = 1.8;
/// Distance between the places that are tested, metres.
const STEP: f64 = 1.0;

/// What a driver on this way owes to those on the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Duty {
    /// To let them go first.
    GiveWay,
    /// Nothing: they let this one go first.
    GoFirst,
    /// Who is there first goes first.
    Equal,
}

/// A stretch where a way crosses or joins another.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Conflict {
    /// The other way.
    pub(crate) other: usize,
    /// The stretch of this way, metres from its beginning.
    pub(crate) mine: [f64; 2],
    /// The stretch of the other.
    pub(crate) theirs: [f64; 2],
    /// Whether both go on into the same way.
    pub(crate) joins: bool,
    pub(crate) duty: Duty,
}

/// Finds all conflicts of a network.
pub(super) fn find(network: &mut Network, layout: &Layout) {
    let bounds: Vec<Bounds> = network
        .ways
        .iter()
        .map(|w| Bounds::of(w.line.points().iter().copied()).inflated(0.5 * SIDE_BY_SIDE))
        .collect();
    let yields = |i: usize, j: usize| {
        let (a, b) = (&layout.map.lanes[i].id, &layout.map.lanes[j].id);
        layout
            .priorities
            .iter()
            .filter(|p| p.lane == *a && p.rule != RightOfWay::AllWayStop)
            .any(|p| p.to.contains(b))
    };
    for i in 0..network.ways.len() {
        for j in i + 1..network.ways.len() {
            let (a, b) = (&network.ways[i], &network.ways[j]);
            let follow = a.next.contains(&j) || b.next.contains(&i);
            let twins = a.twins.iter().any(|t| t.0 == j);
            if follow || twins || !bounds[i].intersects(&bounds[j]) {
                continue;
            }
            let (gives, takes) = (yields(i, j), yields(j, i));
            let joins = a.next.iter().any(|n| b.next.contains(n));
            if !(a.connector && b.connector || gives || takes || joins) {
                continue;
            }
            let Some((mine, theirs)) = stretches(a, b, joins) else { continue };
            let duty = |gives, takes| match (gives, takes) {
                (true, false) => Duty::GiveWay,
                (false, true) => Duty::GoFirst,
                _ => Duty::Equal,
            };
            let (first, second) = (duty(gives, takes), duty(takes, gives));
            network.ways[i].conflicts.push(Conflict { other: j, mine, theirs, joins, duty: first });
            network.ways[j].conflicts.push(Conflict {
                other: i,
                mine: theirs,
                theirs: mine,
                joins,
                duty: second,
            });
        }
    }
}

/// The stretches on which two ways are too close for two vehicles.
fn stretches(a: &Way, b: &Way, joins: bool) -> Option<([f64; 2], [f64; 2])> {
    let near = match (a.bicycles || b.bicycles, joins) {
        (true, _) => BICYCLE,
        (false, true) => SIDE_BY_SIDE,
        (false, false) => VEHICLES,
    };
    let on = |x: &Way, y: &Way| -> Option<[f64; 2]> {
        let steps = (x.length / STEP) as usize + 1;
        let close = |k: &usize| y.line.project(x.line.at((*k as f64 * STEP).min(x.length))).distance < near;
        let first = (0..=steps).find(close)?;
        let last = if joins { steps } else { (0..=steps).rev().find(close)? };
        Some([(first as f64 * STEP - STEP).max(0.0), (last as f64 * STEP + STEP).min(x.length)])
    };
    Some((on(a, b)?, on(b, a)?))
}
