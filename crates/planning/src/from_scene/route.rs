//! The route of the logged AV, extended beyond the end of its log.

use std::collections::BTreeSet;

use reactsim_geometry::{Vec2, direction, wrap};
use reactsim_scene::{AgentState, LANE_HALF_WIDTH, Scenario};

use crate::metrics::passed_lanes;
use crate::pdm::without_gaps;
use crate::planner::Route;
use crate::{EgoShape, EgoState, PlanningMap};

use super::AV;

/// Length in metres of the lanes of a route after the last logged position: the way of 8 s at 25 m/s, so that
/// a planner that drives faster than the log does not reach the end of its route.
const LENGTH_AHEAD: f64 = 200.0;
/// Length in metres of the beginning of a lane over which its turn is measured. Connectors begin in the
/// direction of the lane before, and most have turned after this length.
const TURN_LENGTH: f64 = 20.0;
/// Time in seconds before an AV brakes for the end of its route.
const REACTION_TIME: f64 = 1.5;
/// Deceleration of an AV before the end of its route, m/s².
const DECELERATION: f64 = 2.0;
/// Speed up to which an AV stands, m/s.
const STANDSTILL_SPEED: f64 = 0.5;
/// Distance in metres from the front of a standing AV to the end of its route.
const STANDING_GAP: f64 = 3.0;

/// Returns the route of a planner that drives the AV of a scenario; `None` if the map has no lanes.
///
/// 1. The roadblocks that the logged AV passes from the current frame on, as the metric of progress finds
///    them (where lanes overlap: along the likeliest sequence of lanes). Frames at which the AV is absent are
///    left out; if there are any before the last logged position, roadblocks that are not linked are joined
///    by a shortest sequence of roadblocks, where there is one.
/// 2. The log ends, after 8 s in the benchmark. From the lane of the last logged position the route continues
///    through the successor that turns least, the first one in map order on ties, until 200 m of lanes are
///    ahead of that position, or there is no successor that the extension has not passed yet.
/// 3. If the logged AV is in no lane, the route begins with the roadblock of the lane that is nearest to the
///    current box of the AV, and continues as in step 2 from there.
///
/// Of the logged future, the result contains the choice of roadblocks only.
pub fn logged_route(scenario: &Scenario, map: &PlanningMap, shape: &EgoShape) -> Option<Route> {
    let track = scenario.logged(AV);
    let frames = track.iter().enumerate().skip(scenario.start.current());
    let present = frames.filter_map(|(frame, state)| Some((frame, state.filter(AgentState::is_finite)?)));
    let (frames, states): (Vec<usize>, Vec<AgentState>) = present.unzip();
    let centers: Vec<Vec2> = states.iter().map(AgentState::position).collect();
    let ego: Vec<EgoState> = states.iter().map(|state| standing(state, shape)).collect();
    let passed = passed_lanes(map, &ego, &centers);
    let (entered, last, position) = match (passed.last, centers.last()) {
        (Some(last), Some(&position)) => (passed.entered, last, position),
        _ => {
            let now = scenario.start.now(AV);
            let lanes: Vec<usize> = (0..map.lanes().len()).collect();
            let footprint = shape.footprint_at(now.position(), now.heading);
            (Vec::new(), map.nearest_lane(&lanes, &footprint)?, now.position())
        }
    };
    let roadblock = |lane: usize| map.lane(lane).roadblock;
    let mut roadblocks: Vec<usize> = entered.into_iter().map(roadblock).collect();
    if frames.windows(2).any(|pair| pair[1] != pair[0] + 1) {
        roadblocks = without_gaps(map, &roadblocks);
    }
    roadblocks.extend(lanes_ahead(map, last, position).into_iter().map(roadblock));
    Route::of_roadblocks(roadblocks)
}

/// The end of a route that the AV has reached: no lane of the route follows, although the route may continue
/// elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct RouteEnd {
    /// Id of the last lane in the planning map.
    pub lane: String,
    /// End of this lane, metres, in the coordinates of the scenario.
    pub position: Vec2,
    /// Distance along the lanes from the centre of the AV to this position, metres.
    pub ahead: f64,
}

/// Returns the end of the route of the AV of a scenario if the AV has to brake for it: it cannot stop before
/// that end with its front after a reaction time of 1.5 s with a deceleration of 2 m/s², up to a margin of 3
/// m, or it stands there. `ego`: present state of the AV. `None` without a route.
pub fn route_end(
    scenario: &Scenario,
    map: &PlanningMap,
    shape: &EgoShape,
    ego: &EgoState,
) -> Option<RouteEnd> {
    let lanes = logged_route(scenario, map, shape)?.lanes(map);
    let footprint = ego.footprint(shape);
    let end_of = |lane: usize| map.lane(lane).baseline.points()[map.lane(lane).baseline.segments()];
    let end =
        |lane: usize, ahead: f64| RouteEnd { lane: map.lane(lane).id.clone(), position: end_of(lane), ahead };
    let margin = 0.5 * shape.length + STANDING_GAP;
    if ego.speed() < STANDSTILL_SPEED {
        let distance = |&lane: &usize| (end_of(lane) - footprint.center).norm();
        let is_last = |lane: &usize| !map.lane(*lane).successors.iter().any(|next| lanes.contains(next));
        // Where lanes overlap, the AV may be along another lane than the one that it stopped in; the end of a
        // lane beside it means nothing.
        let is_before =
            |&lane: &usize| footprint.axis.perp(&(end_of(lane) - footprint.center)).abs() < LANE_HALF_WIDTH;
        let is_reached = |lane: &usize| is_last(lane) && distance(lane) < margin && is_before(lane);
        if let Some(&lane) = lanes.iter().find(|lane| is_reached(lane)) {
            return Some(end(lane, distance(&lane)));
        }
    }
    let alignment = |lane: usize| {
        let baseline = &map.lane(lane).baseline;
        wrap(baseline.heading(baseline.project(footprint.center).segment) - ego.heading).abs()
    };
    let containing = lanes.iter().copied().filter(|&lane| map.lane_contains(lane, footprint.center));
    let lane = containing.min_by(|&a, &b| alignment(a).total_cmp(&alignment(b)));
    let lane = lane.or_else(|| map.nearest_lane(&lanes, &footprint))?;
    let stopping = margin + ego.vx * REACTION_TIME + ego.vx * ego.vx / (2.0 * DECELERATION);
    let baseline = &map.lane(lane).baseline;
    let rest = baseline.length() - baseline.project(footprint.center).s;
    let (ahead, last) = farthest(map, &lanes, lane, rest, stopping);
    (ahead < stopping).then(|| end(last, ahead))
}

/// Returns the length of the longest sequence of the `lanes` of a route from the end of `lane`, to which
/// `ahead` metres are left, and its last lane; of a sequence longer than `enough` metres, only the beginning.
fn farthest(map: &PlanningMap, lanes: &[usize], lane: usize, ahead: f64, enough: f64) -> (f64, usize) {
    let mut best = (ahead, lane);
    let mut open = vec![(ahead, lane)];
    let mut seen = BTreeSet::from([lane]);
    while let Some((ahead, lane)) = open.pop().filter(|_| best.0 < enough) {
        for &next in map.lane(lane).successors.iter().filter(|next| lanes.contains(next)) {
            let reached = (ahead + map.lane(next).baseline.length(), next);
            if seen.insert(next) {
                open.push(reached);
            }
            if reached.0 > best.0 {
                best = reached;
            }
        }
    }
    best
}

/// Returns a state with this pose. Passed lanes depend on poses only.
fn standing(state: &AgentState, shape: &EgoShape) -> EgoState {
    let rear_axle = state.position() - direction(state.heading) * shape.rear_axle_to_center;
    EgoState::standing(rear_axle, state.heading)
}

/// Returns `lane` and the lanes after it until [`LENGTH_AHEAD`] is ahead of `position`, or no new successor
/// is left.
fn lanes_ahead(map: &PlanningMap, lane: usize, position: Vec2) -> Vec<usize> {
    let baseline = &map.lane(lane).baseline;
    let mut ahead = baseline.length() - baseline.project(position).s;
    let mut lanes = vec![lane];
    let mut last = lane;
    while ahead < LENGTH_AHEAD
        && let Some(next) = straightest(map, last, &lanes)
    {
        ahead += map.lane(next).baseline.length();
        lanes.push(next);
        last = next;
    }
    lanes
}

/// Returns the successor that turns least, without those already `passed`.
fn straightest(map: &PlanningMap, lane: usize, passed: &[usize]) -> Option<usize> {
    let baseline = &map.lane(lane).baseline;
    let end = baseline.heading(baseline.segments() - 1);
    let turn = |&next: &usize| {
        let next = &map.lane(next).baseline;
        wrap(next.heading_at(next.length().min(TURN_LENGTH)) - end).abs()
    };
    let mut successors = map.lane(lane).successors.clone();
    successors.sort_unstable();
    successors.retain(|next| !passed.contains(next));
    successors.into_iter().min_by(|a, b| turn(a).total_cmp(&turn(b)))
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Polyline;
    use reactsim_scene::{AgentKind, LaneKind, LaneParts};

    use super::*;
    use crate::fixtures::scenes::{agent, beside, lane, scenario, straight_track, track};
    use crate::from_scene::{ego_shape, planning_map};

    /// Returns the ids of the roadblocks of the route.
    fn route(scenario: &Scenario) -> Option<Vec<String>> {
        let (map, shape) = (planning_map(scenario).unwrap(), ego_shape(scenario).unwrap());
        let route = logged_route(scenario, &map, &shape)?;
        let id = |&block: &usize| map.roadblocks()[block].id.replace("roadblock of ", "");
        Some(route.roadblocks().iter().map(id).collect())
    }

    /// A road along the x axis of lanes of 60 m, with a turn to the left at the end of the third one.
    fn fork() -> Vec<LaneParts> {
        vec![
            lane("a", &[(-50.0, 0.0), (10.0, 0.0)], &["b"]),
            lane("b", &[(10.0, 0.0), (70.0, 0.0)], &["c"]),
            lane("c", &[(70.0, 0.0), (130.0, 0.0)], &["left", "d"]),
            lane("left", &[(130.0, 0.0), (140.0, 5.0), (145.0, 60.0)], &[]),
            lane("d", &[(130.0, 0.0), (190.0, 0.0)], &["e"]),
            lane("e", &[(190.0, 0.0), (250.0, 0.0)], &["f"]),
            lane("f", &[(250.0, 0.0), (310.0, 0.0)], &["g"]),
            lane("g", &[(310.0, 0.0), (370.0, 0.0)], &[]),
        ]
    }

    #[test]
    fn routes_follow_the_log_and_then_the_lanes_that_turn_least() {
        let av = |speed| agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, speed));
        // The log ends at 80 m, the lane at 130 m: the route is complete in lane f, which begins at 250 m.
        assert_eq!(route(&scenario(vec![av(10.0)], fork())).unwrap(), ["a", "b", "c", "d", "e", "f"]);
        assert_eq!(route(&scenario(vec![av(1.0)], fork())).unwrap(), ["a", "b", "c", "d", "e"]);
        assert_eq!(route(&scenario(vec![av(30.0)], fork())).unwrap(), ["a", "b", "c", "d", "e", "f", "g"]);
    }

    #[test]
    fn gaps_of_the_log_are_bridged() {
        let mut cut = scenario(vec![agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, 10.0))], fork());
        cut.log_future.tracks[0][5..75].fill(None);
        assert_eq!(route(&cut).unwrap(), ["a", "b", "c", "d", "e", "f"]);
        cut.log_future.tracks[0][5..].fill(None);
        assert_eq!(route(&cut).unwrap(), ["a", "b", "c", "d", "e"]);
        assert_eq!(route(&cut.without_future()).unwrap(), ["a", "b", "c", "d", "e"]);
    }

    #[test]
    fn rings_end() {
        let ring = vec![
            lane("a", &[(-20.0, 0.0), (20.0, 0.0)], &["b"]),
            lane("b", &[(20.0, 0.0), (20.0, 20.0), (-20.0, 20.0), (-20.0, 0.0)], &["a"]),
        ];
        let standing = agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, 0.0));
        assert_eq!(route(&scenario(vec![standing], ring)).unwrap(), ["a", "b"]);
    }

    #[test]
    fn forks_are_decided_by_the_lanes_that_follow() {
        let branch = |id, points: &[(f64, f64)], successors: &[&str]| LaneParts {
            kind: LaneKind::Connector,
            ..lane(id, points, successors)
        };
        let lanes = vec![
            branch("in", &[(-50.0, 0.0), (10.0, 0.0)], &["ahead", "left"]),
            branch("ahead", &[(10.0, 0.0), (100.0, 0.0)], &[]),
            branch("left", &[(10.0, 0.0), (20.0, 3.0), (25.0, 10.0), (27.0, 20.0), (27.0, 30.0)], &["out"]),
            branch("out", &[(27.0, 30.0), (27.0, 90.0)], &[]),
            // Where the AV cuts the corner; no lane leads here.
            branch("other", &[(12.0, 1.5), (18.0, 5.0), (24.5, 14.0), (25.0, 20.0)], &[]),
        ];
        let corner = [(-50.0, 0.0), (8.0, 0.0), (18.0, 5.0), (24.5, 14.0), (27.0, 25.0), (27.0, 90.0)];
        let points: Vec<Vec2> = corner.iter().map(|&(x, y)| Vec2::new(x, y)).collect();
        let path = Polyline::new(&points).unwrap();
        let turning = track(8.0, |way| (path.at(way + 50.0), path.heading_at(way + 50.0)));
        let turning = scenario(vec![agent("av", AgentKind::Vehicle, turning)], lanes);
        assert_eq!(route(&turning).unwrap(), ["in", "left", "out"]);
    }

    #[test]
    fn the_end_of_a_route_is_found_before_the_av_reaches_it() {
        let linked = scenario(vec![agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, 10.0))], fork());
        let mut cut = fork();
        cut[0].successors.clear();
        let cut = scenario(vec![agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, 10.0))], cut);
        let end = |scenario: &Scenario, x: f64, speed: f64| {
            let (map, shape) = (planning_map(scenario).unwrap(), ego_shape(scenario).unwrap());
            let rear_axle = Vec2::new(x - shape.rear_axle_to_center, 0.0);
            let ego = EgoState { vx: speed, ..EgoState::standing(rear_axle, 0.0) };
            route_end(scenario, &map, &shape, &ego)
        };
        let found = end(&cut, 6.0, 0.0).unwrap();
        assert_eq!((found.lane.as_str(), found.position), ("a", Vec2::new(10.0, 0.0)));
        assert!((found.ahead - 4.0).abs() < 1e-9);
        assert_eq!(end(&cut, 4.0, 0.0), None);
        // 15 m of reaction, 25 m of braking.
        assert!(end(&cut, -35.0, 10.0).is_some());
        assert_eq!(end(&cut, -36.0, 10.0), None);
        assert_eq!(end(&linked, 6.0, 10.0), None);
        // A lane beside that of the AV ends.
        let mut lanes = fork();
        lanes.push(lane("turn", &[(-50.0, 3.5), (10.0, 3.5)], &[]));
        lanes[0].left.push(beside("turn"));
        let av = agent("av", AgentKind::Vehicle, straight_track(0.0, 0.0, 10.0));
        assert_eq!(end(&scenario(vec![av], lanes), 6.0, 0.0), None);
        assert_eq!(end(&linked, 360.0, 10.0).unwrap().lane, "f");
    }

    #[test]
    fn away_from_all_lanes_the_nearest_one_counts() {
        let aside = agent("av", AgentKind::Vehicle, straight_track(200.0, -30.0, 0.0));
        assert_eq!(route(&scenario(vec![aside.clone()], fork())).unwrap(), ["e", "f", "g"]);
        assert_eq!(route(&scenario(vec![aside], Vec::new())), None);
    }
}
