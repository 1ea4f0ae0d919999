//! Links between lanes that no vehicle can drive.

use std::collections::BTreeSet;

use reactsim_geometry::{Polyline, Vec2, math, signed_angle_between};

use super::{LANE_HALF_WIDTH, RoadMap, Scenario};

/// Largest distance from the end of a lane to the start of its successor, metres. Of 58,110 links of Waymo
/// recordings, 57,992 meet within 1 cm. The others skip a lane that is not recorded: a vehicle finds its way
/// across a junction, which is up to about 20 m wide, but not farther.
const MAX_LINK_GAP: f64 = 20.0;
/// Distance up to which lanes meet, metres: vehicles deviate by this much within a lane.
const MEETING_DISTANCE: f64 = LANE_HALF_WIDTH;
/// Largest angle in radians between a lane and the gap to its successor, or between lanes that meet: 120°,
/// more than at the tightest corner or U-turn. A successor that begins behind the end is at a larger one.
const MAX_ANGLE: f64 = 2.1;
/// Largest curvature of the path across a gap, 1/m: that from which motion is infeasible.
const MAX_CURVATURE: f64 = 0.3;
/// Length of both lanes that the path across a gap can use, metres.
const CUT: f64 = 2.0;

impl Scenario {
    /// Drops the links between lanes that no vehicle can drive, and counts them in [`Scenario::repairs`].
    /// Returns whether there were any.
    pub(super) fn drop_undrivable_links(&mut self) -> bool {
        let undrivable = undrivable_links(&self.start.map);
        if undrivable.is_empty() {
            return false;
        }
        for (i, lane) in self.start.map.edit().lanes.iter_mut().enumerate() {
            lane.successors.retain(|next| !undrivable.contains(&(i, *next)));
            lane.predecessors.retain(|before| !undrivable.contains(&(*before, i)));
        }
        *self.repairs.entry("links between lanes that do not meet".to_owned()).or_default() +=
            undrivable.len() as u32;
        true
    }
}

/// Returns the pairs of a lane and its successor that a vehicle cannot drive.
fn undrivable_links(map: &RoadMap) -> BTreeSet<(usize, usize)> {
    let lanes = map.lanes.iter().enumerate();
    let links = lanes.flat_map(|(i, lane)| {
        let next = lane.successors.iter().map(move |next| (i, *next));
        next.chain(lane.predecessors.iter().map(move |before| (*before, i)))
    });
    let line = |lane: usize| &map.lanes[lane].baseline;
    links.filter(|(from, to)| !is_drivable(line(*from), line(*to))).collect()
}

/// Returns whether a vehicle can drive from the end of a lane to the start of another one.
fn is_drivable(before: &Polyline, after: &Polyline) -> bool {
    let end = before.at(before.length());
    let leaving = direction_between(before.at((before.length() - CUT).max(0.0)), end);
    let start = after.at(0.0);
    let entering = direction_between(start, after.at(CUT));
    let angles = |gap: Vec2| [signed_angle_between(leaving, gap), signed_angle_between(gap, entering)];
    let gap = start - end;
    if gap.norm() <= MEETING_DISTANCE {
        return signed_angle_between(leaving, entering).abs() <= MAX_ANGLE;
    }
    if gap.norm() > MAX_LINK_GAP || angles(gap).iter().any(|angle| angle.abs() > MAX_ANGLE) {
        return false;
    }
    // Along a circle, both angles to the chord are equal. Two bends in opposite directions share the chord.
    let chord = gap + (leaving + entering) * CUT;
    let [first, second] = angles(chord);
    let curvature = if first * second < 0.0 {
        4.0 * math::sin(first.abs().max(second.abs())) / chord.norm()
    } else {
        2.0 * math::sin((first + second).abs() / 2.0) / chord.norm()
    };
    curvature <= MAX_CURVATURE
}

fn direction_between(from: Vec2, to: Vec2) -> Vec2 {
    (to - from).normalize()
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;
    use crate::{Agent, AgentKind, AgentState, FRAMES, LaneParts, LoggedAgent, MapParts, ScenarioParts};

    fn lane(id: &str, points: &[(f64, f64)], after: &[&str], before: &[&str]) -> LaneParts {
        LaneParts {
            id: id.to_owned(),
            points: points.iter().map(|(x, y)| Vec2::new(*x, *y)).collect(),
            successors: after.iter().map(|id| (*id).to_owned()).collect(),
            predecessors: before.iter().map(|id| (*id).to_owned()).collect(),
            ..LaneParts::default()
        }
    }

    fn assemble(lanes: Vec<LaneParts>) -> Scenario {
        let state = AgentState { x: 0.0, y: 0.0, heading: 0.0, vx: 0.0, vy: 0.0 };
        let agent = Agent { id: "av".into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 };
        Scenario::assemble(ScenarioParts {
            id: "made".into(),
            origin: Some(Vec2::zeros()),
            agents: vec![LoggedAgent { agent, track: vec![Some(state); FRAMES], heights: Vec::new() }],
            map: MapParts { lanes, ..MapParts::default() },
            ..ScenarioParts::default()
        })
        .unwrap()
    }

    #[test]
    fn links_that_no_vehicle_can_drive_are_dropped_and_counted() {
        let straight = |id, x: f64, y: f64, after, before| lane(id, &[(x, y), (x + 50.0, y)], after, before);
        let scenario = assemble(vec![
            straight("a", 0.0, 0.0, &["near", "far"], &[]),
            straight("near", 50.0 + MAX_LINK_GAP, 0.0, &[], &["a"]),
            // Stated from both sides, and from one side only.
            straight("far", 50.0, 200.0, &[], &["a"]),
            straight("aside", 50.0, 21.0, &[], &["a"]),
        ]);
        let lanes = &scenario.start.map.lanes;
        assert_eq!(lanes[0].successors, [1]);
        assert_eq!(lanes[1].predecessors, [0]);
        assert!(lanes[2].predecessors.is_empty() && lanes[3].predecessors.is_empty());
        assert_eq!(scenario.repairs["links between lanes that do not meet"], 2);
    }

    #[test]
    fn headings_and_curvature_decide_within_20_metres() {
        let is_kept = |x: f64, y: f64, degrees: f64| {
            let (sin, cos) = (math::sin(degrees.to_radians()), math::cos(degrees.to_radians()));
            let next = [(50.0 + x, y), (50.0 + x + 30.0 * cos, y + 30.0 * sin)];
            let lanes = vec![lane("a", &[(0.0, 0.0), (50.0, 0.0)], &["b"], &[]), lane("b", &next, &[], &[])];
            !assemble(lanes).start.map.lanes[0].successors.is_empty()
        };
        // Lanes that meet, corners, turns across a junction, a U-turn around a median, and a lane shift.
        for (x, y, degrees) in [
            (0.0, 0.0, 0.0),
            (0.0, 0.3, 90.0),
            (-0.5, 0.0, 20.0),
            (12.0, 9.0, 90.0),
            (6.0, -6.0, -80.0),
            (0.0, 12.0, 180.0),
            (-2.0, 14.0, 170.0),
            (8.0, 3.5, 0.0),
            (2.0, 0.6, 5.0),
            (17.0, 0.0, 0.0),
        ] {
            assert!(is_kept(x, y, degrees), "{x} {y} {degrees}");
        }
        // Against the direction, behind the end, across the turn, a lane beside, and turns that are too
        // tight.
        for (x, y, degrees) in [
            (0.0, 0.0, 180.0),
            (10.0, 0.0, 180.0),
            (-6.0, 0.0, 0.0),
            (-15.0, 3.5, 0.0),
            (-10.0, 12.0, 140.0),
            (3.0, 17.0, -120.0),
            (0.0, 3.5, 0.0),
            (0.0, 3.5, 180.0),
            (1.0, 4.0, -45.0),
        ] {
            assert!(!is_kept(x, y, degrees), "{x} {y} {degrees}");
        }
    }
}
