//! Conflicts where lanes cross or join, and the right of way there.

use reactsim_geometry::Bounds;

use super::super::super::heights::on_different_levels;
use super::super::super::{Layout, RightOfWay};
use super::{Network, TrafficLane};

/// Distance of centre lines, metres, below which crossing lanes conflict: two vehicles of usual width with
/// clearance.
const CROSSING_DISTANCE: f64 = 2.3;
/// The same distance for joining lanes, on which vehicles would drive side by side for long, metres.
const JOINING_DISTANCE: f64 = 2.8;
/// The same distance if one of the lanes is for bicycles, metres.
const BICYCLE_DISTANCE: f64 = 1.8;
/// Distance between two tested points, metres.
const TEST_SPACING: f64 = 1.0;

/// Duty of a driver on this lane towards drivers on the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Duty {
    /// To yield.
    GiveWay,
    /// To proceed: the others yield.
    GoFirst,
    /// First come, first served.
    Equal,
}

/// A stretch where a lane crosses or joins another.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Conflict {
    /// Index of the other lane.
    pub(crate) other: usize,
    /// Stretch of this lane, metres from its beginning.
    pub(crate) mine: [f64; 2],
    /// Stretch of the other lane, metres from its beginning.
    pub(crate) theirs: [f64; 2],
    /// Whether both lanes lead into the same lane.
    pub(crate) joins: bool,
    pub(crate) duty: Duty,
}

pub(super) fn find(network: &mut Network, layout: &Layout) {
    let bounds: Vec<Bounds> = network
        .lanes
        .iter()
        .map(|lane| Bounds::of(lane.line.points().iter().copied()).inflated(0.5 * JOINING_DISTANCE))
        .collect();
    let yields = |i: usize, j: usize| {
        let (a, b) = (&layout.map.lanes[i].id, &layout.map.lanes[j].id);
        layout
            .priorities
            .iter()
            .filter(|p| p.lane == *a && p.rule != RightOfWay::AllWayStop)
            .any(|p| p.to.contains(b))
    };
    for i in 0..network.lanes.len() {
        for j in i + 1..network.lanes.len() {
            let (a, b) = (&network.lanes[i], &network.lanes[j]);
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
            network.lanes[i].conflicts.push(Conflict { other: j, mine, theirs, joins, duty: first });
            network.lanes[j].conflicts.push(Conflict {
                other: i,
                mine: theirs,
                theirs: mine,
                joins,
                duty: second,
            });
        }
    }
}

/// Returns the stretches on which two lanes are too close for two vehicles side by side, on one level.
fn stretches(a: &TrafficLane, b: &TrafficLane, joins: bool) -> Option<([f64; 2], [f64; 2])> {
    let near = match (a.bicycles || b.bicycles, joins) {
        (true, _) => BICYCLE_DISTANCE,
        (false, true) => JOINING_DISTANCE,
        (false, false) => CROSSING_DISTANCE,
    };
    let on = |x: &TrafficLane, y: &TrafficLane| -> Option<[f64; 2]> {
        let steps = (x.length / TEST_SPACING) as usize + 1;
        let close = |k: &usize| {
            let s = (*k as f64 * TEST_SPACING).min(x.length);
            let at = y.line.project(x.line.at(s));
            at.distance < near && !on_different_levels(x.height_at(s), y.height_at(at.s), at.distance)
        };
        let first = (0..=steps).find(close)?;
        let last = if joins { steps } else { (0..=steps).rev().find(close)? };
        Some([
            (first as f64 * TEST_SPACING - TEST_SPACING).max(0.0),
            (last as f64 * TEST_SPACING + TEST_SPACING).min(x.length),
        ])
    };
    Some((on(a, b)?, on(b, a)?))
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;
    use reactsim_scene::{LaneKind, LaneParts, MapHeights, MapParts};

    use super::*;

    fn connector(id: &str, from: Vec2, to: Vec2) -> LaneParts {
        LaneParts {
            id: id.to_owned(),
            kind: LaneKind::Connector,
            points: vec![from, to],
            ..LaneParts::default()
        }
    }

    #[test]
    fn lanes_on_different_levels_do_not_conflict() {
        let lanes = vec![
            connector("east", Vec2::new(-60.0, 0.0), Vec2::new(60.0, 0.0)),
            connector("north", Vec2::new(0.0, -60.0), Vec2::new(0.0, 60.0)),
        ];
        let conflicts = |heights: Vec<Vec<f64>>| {
            let heights = MapHeights { lanes: heights, ..MapHeights::default() };
            let map = MapParts { lanes: lanes.clone(), heights, ..MapParts::default() };
            let network = Network::new(&Layout { map, ..Layout::default() });
            network.lanes.iter().map(|l| l.conflicts.len()).sum::<usize>()
        };
        assert_eq!(conflicts(Vec::new()), 2);
        assert_eq!(conflicts(vec![vec![0.0, 0.0], vec![0.0, 0.0]]), 2);
        // Both ends of the ramp are 6 m away from the height in its middle.
        assert_eq!(conflicts(vec![vec![0.0, 0.0], vec![0.0, 12.0]]), 0);
    }
}
