//! Histories of rollouts of scenarios made by hand.

use reactsim_geometry::{Polygon, Vec2};
use reactsim_scene::{
    AgentKind, AgentState, Frame, LaneClass, LaneKind, LaneParts, Length, LoggedAgent, RoadEdge,
    RoadEdgeKind, Scenario, ScenarioParts,
};

use super::SceneHistory;
use crate::fixtures::scenes::{self, beside, straight_track};
use crate::map::{DrivableArea, Intersections};
use crate::metrics::{Label, MetricValue, PlannerMetric, UndefinedReason};
use crate::{EgoShape, ObjectKind};

const CAR: [f64; 2] = [5.176, 2.297];

fn v(x: f64, y: f64) -> Vec2 {
    Vec2::new(x, y)
}

fn agent(id: &str, kind: AgentKind, [length, width]: [f64; 2], start: Vec2, speed: f64) -> LoggedAgent {
    let mut logged = scenes::agent(id, kind, straight_track(start.x, start.y, speed));
    (logged.agent.length, logged.agent.width) = (length, width);
    logged
}

fn lane(id: &str, kind: LaneKind, x: [f64; 2], y: f64, successors: &[&str]) -> LaneParts {
    LaneParts { kind, speed_limit: Some(13.0), ..scenes::lane(id, &[(x[0], y), (x[1], y)], successors) }
}

/// Two parallel lanes, `a` and `b`, with a connector behind each, which lead to `a2` and `b2`; and a bike
/// lane.
fn lanes() -> Vec<LaneParts> {
    let bikes = lane("bikes", LaneKind::Lane, [-50.0, 200.0], -1.0, &[]);
    let mut lanes = vec![LaneParts { class: LaneClass::Bike, ..bikes }];
    for (name, y) in [("a", 0.0), ("b", 3.5)] {
        let (connector, after) = (format!("c{name}"), format!("{name}2"));
        lanes.extend([
            lane(name, LaneKind::Lane, [-50.0, 40.0], y, &[&connector]),
            lane(&connector, LaneKind::Connector, [40.0, 60.0], y, &[&after]),
            lane(&after, LaneKind::Lane, [60.0, 200.0], y, &[]),
        ]);
    }
    for [right, left] in [["a", "b"], ["a2", "b2"]] {
        let find = |id: &str| lanes.iter().position(|lane| lane.id == id).unwrap();
        let (a, b) = (find(right), find(left));
        lanes[a].left.push(beside(left));
        lanes[b].right.push(beside(right));
    }
    lanes
}

fn scenario(change: impl FnOnce(&mut ScenarioParts)) -> Scenario {
    let agents = vec![
        agent("av", AgentKind::Vehicle, CAR, v(0.0, 0.0), 10.0),
        agent("walker", AgentKind::Pedestrian, [0.8, 0.8], v(30.0, 8.0), 1.0),
        agent("rider", AgentKind::Cyclist, [1.8, 0.6], v(20.0, 3.5), 6.0),
        agent("cone", AgentKind::Other, [0.4, 0.4], v(10.0, 8.0), 0.0),
    ];
    let mut parts = scenes::parts(agents, lanes());
    change(&mut parts);
    Scenario::assemble(parts).unwrap()
}

fn logged(scenario: &Scenario) -> Vec<Vec<Frame>> {
    (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect()
}

fn history(scenario: &Scenario) -> SceneHistory {
    SceneHistory::of_rollout(scenario, &logged(scenario)).unwrap()
}

fn with_road(parts: &mut ScenarioParts) {
    let road = vec![v(-50.0, -1.75), v(200.0, -1.75), v(200.0, 5.25), v(-50.0, 5.25)];
    parts.map.drivable_area = Some(vec![Polygon { exterior: road, holes: Vec::new() }]);
}

#[test]
fn a_complete_scenario_has_a_complete_score() {
    let scores = history(&scenario(with_road)).judge().unwrap();
    assert_eq!(scores.score.cls(), Some(1.0));
    assert_eq!(scores.center_lanes.len(), 81);
    let labels: Vec<_> = scores.labels.iter().map(|label| label.name()).collect();
    let expected =
        ["lanes: corridors", "intersection: connectors", "route: neighbour-groups", "ego: differences"];
    assert_eq!(labels, expected);
}

#[test]
fn roadblocks_are_groups_of_neighbours() {
    let map = history(&scenario(with_road)).map;
    assert_eq!(map.lanes().len(), 6, "the bike lane is left out");
    let block = |id: &str| map.lane(map.find_lane(id).unwrap()).roadblock;
    assert_eq!([block("a"), block("ca"), block("a2")], [block("b"), block("cb"), block("b2")]);
    assert_eq!(map.roadblocks().len(), 3);
    assert!(map.roadblock_contains(block("a"), v(0.0, 3.5)));
    let link = map.lane(map.find_lane("a").unwrap()).successors[0];
    assert_eq!(map.lane(link).id, "ca");
}

#[test]
fn objects_have_kinds_and_obstacles_stay() {
    let history = history(&scenario(with_road));
    let kinds: Vec<_> = history.objects[80].iter().map(|object| object.kind).collect();
    assert_eq!(kinds, [ObjectKind::Bicycle, ObjectKind::Pedestrian, ObjectKind::GenericObject]);
    assert_eq!(history.objects[80][0].center.x, 20.0 + 48.0);
    assert_eq!(history.objects[80][2].center, history.objects[0][2].center);
    assert_eq!((history.ego[0].time, history.ego[0].x), (0.0, -1.461));
    assert_eq!(history.shape, EgoShape::PACIFICA);
}

#[test]
fn gaps_and_unknown_velocities_of_objects() {
    let scenario = scenario(with_road);
    let mut tracks = logged(&scenario);
    let rider = scenario.start.agents.iter().position(|agent| agent.id == "rider").unwrap();
    tracks[rider][50] = None;
    let unknown = tracks[rider][30].as_mut().unwrap();
    (unknown.vx, unknown.vy) = (f64::NAN, f64::NAN);
    let history = SceneHistory::of_rollout(&scenario, &tracks).unwrap();
    assert_eq!(history.objects[40].len(), 2);
    let estimated = history.objects[20].iter().find(|object| &*object.id == "rider").unwrap();
    assert!((estimated.velocity - v(6.0, 0.0)).norm() < 1e-9);
    assert!(history.labels.contains(&Label::SpeedsDisplacement));
}

#[test]
fn maps_of_connectors_and_road_edges_are_labelled() {
    let scenario = scenario(|parts| {
        parts.map.lanes.iter_mut().for_each(|lane| lane.kind = LaneKind::Connector);
        let edge = |points| RoadEdge { kind: RoadEdgeKind::Boundary, points };
        parts.map.road_edges =
            vec![edge(vec![v(-50.0, -1.75), v(200.0, -1.75)]), edge(vec![v(200.0, 5.25), v(-50.0, 5.25)])];
        parts.agents[0].agent.length = 4.5;
    });
    let history = history(&scenario);
    assert!(matches!(history.map.intersections(), Intersections::Unknown));
    assert!(matches!(history.map.drivable(), DrivableArea::RoadEdges { .. }));
    assert_eq!(history.map.roadblocks().len(), 4, "connectors without neighbours are groups of their own");
    let scores = history.judge().unwrap();
    assert_eq!(scores.score.cls(), Some(1.0));
    for label in [
        Label::LanesCorridors,
        Label::LanesOverlapping,
        Label::DirectionOverlapping,
        Label::DrivableRoadEdges,
        Label::IntersectionUnknown,
        Label::VehicleScaled,
    ] {
        assert!(scores.labels.contains(&label), "{}", label.name());
    }
}

#[test]
fn leaving_the_road_over_its_edge_is_a_violation() {
    let scenario = scenario(|parts| {
        let points = vec![v(-50.0, -1.75), v(200.0, -1.75)];
        parts.map.road_edges = vec![RoadEdge { kind: RoadEdgeKind::Boundary, points }];
    });
    let mut tracks = logged(&scenario);
    let value = |tracks: &[Vec<Frame>]| {
        let scores = SceneHistory::of_rollout(&scenario, tracks).unwrap().judge().unwrap();
        scores.value(PlannerMetric::DrivableArea)
    };
    assert_eq!(value(&tracks), MetricValue::Defined(1.0));
    tracks[0][60].as_mut().unwrap().y = -1.0;
    assert_eq!(value(&tracks), MetricValue::Defined(0.0));
}

#[test]
fn missing_inputs_leave_metrics_undefined() {
    let scenario = scenario(|parts| {
        parts.map.lanes.iter_mut().for_each(|lane| lane.speed_limit = None);
        parts.agents[0].track[70] = None;
    });
    let mut tracks = logged(&scenario);
    tracks[0][70] = tracks[0][69];
    let scores = SceneHistory::of_rollout(&scenario, &tracks).unwrap().judge().unwrap();
    let undefined = |metric: PlannerMetric| scores.value(metric);
    assert_eq!(
        undefined(PlannerMetric::SpeedLimit),
        MetricValue::Undefined(UndefinedReason::UnknownSpeedLimits)
    );
    assert_eq!(undefined(PlannerMetric::Progress), MetricValue::Undefined(UndefinedReason::IncompleteExpert));
    assert_eq!(
        undefined(PlannerMetric::DrivableArea),
        MetricValue::Undefined(UndefinedReason::NoDrivableArea)
    );
    assert_eq!(scores.score.id(), "cls-partial");
}

#[test]
fn rollouts_that_do_not_fit_are_refused() {
    let scenario = scenario(with_road);
    let mut tracks = logged(&scenario);
    tracks[0][50] = None;
    let absent = SceneHistory::of_rollout(&scenario, &tracks).unwrap_err();
    assert!(absent.to_string().contains("the AV has no finite state at every frame"), "{absent}");
    let few = SceneHistory::of_rollout(&scenario, &logged(&scenario)[..2]).unwrap_err();
    assert_eq!(few.to_string(), "scenario `made`: 2 tracks for 3 agents; give one track per agent");
}

#[test]
fn every_step_of_a_scenario_is_a_sample() {
    for (history, future) in [(2, 60), (11, 150), (21, 80), (11, 600), (11, 3)] {
        let length = Length { history, future };
        let current = length.current();
        let scenario = scenario(|parts| {
            with_road(parts);
            parts.length = length;
            for (i, agent) in parts.agents.iter_mut().enumerate() {
                let now = agent.track[10].unwrap();
                // All fit on the road for a minute.
                let speed = if i == 0 { 2.0 } else { 0.0 };
                let state = |frame: usize| {
                    let t = 0.1 * (frame as f64 - current as f64);
                    Some(AgentState { x: now.x + speed * t, vx: speed, ..now })
                };
                agent.track = (0..length.frames()).map(state).collect();
            }
        });
        let found = self::history(&scenario);
        assert_eq!((found.ego.len(), found.objects.len()), (future + 1, future + 1));
        assert_eq!(found.expert.as_ref().map(Vec::len), Some(future + 1));
        assert!((found.ego[future].x - found.ego[0].x - 0.2 * future as f64).abs() < 1e-9);
        assert_eq!(found.judge().unwrap().center_lanes.len(), future + 1);
        let mut tracks = logged(&scenario);
        tracks[0][length.frames() - 1] = None;
        let error = SceneHistory::of_rollout(&scenario, &tracks).unwrap_err().to_string();
        let place = format!("every frame from {current} to {}", length.frames() - 1);
        assert!(error.contains(&place), "{error}");
    }
}
