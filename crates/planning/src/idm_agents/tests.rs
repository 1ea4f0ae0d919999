//! Rules of the agents that golden documents do not single out, on small roads.

use reactsim_geometry::Vec2;

use super::*;
use crate::fixtures::{LanePart, car, map, straight_road};
use crate::map::LaneKind;
use crate::planner::LightState;

const PARAMETERS: Parameters = Parameters {
    target_speed: 10.0,
    min_gap: 1.0,
    headway: 1.5,
    acceleration: 1.0,
    deceleration: 2.0,
    min_path: 20.0,
    radius: 100.0,
};

/// A lane to a connector with a signal, and a lane behind it, along the x axis.
fn signalled() -> AgentRoads {
    let parts = [
        LanePart { x: [0.0, 50.0], successors: &["through"], ..LanePart::new("lane") },
        LanePart {
            kind: LaneKind::Connector,
            x: [50.0, 60.0],
            roadblock: "junction",
            successors: &["behind"],
            ..LanePart::new("through")
        },
        LanePart { x: [60.0, 300.0], roadblock: "after", ..LanePart::new("behind") },
    ];
    let line = vec![Vec2::new(50.0, 0.0), Vec2::new(50.0, 3.5)];
    let stop = SignalLine { id: "stop".to_owned(), outline: line, connectors: vec![1] };
    AgentRoads::new(map(&parts), &[1], vec![stop])
}

fn on(roads: AgentRoads, objects: &[TrackedObject]) -> IdmAgents {
    IdmAgents::new(Arc::new(roads), PARAMETERS, objects, None)
}

fn free(limit: Option<f64>) -> AgentRoads {
    AgentRoads::new(straight_road(limit), &[], Vec::new())
}

fn step(agents: &mut IdmAgents, lights: &[Light]) {
    agents.step(&Step { center: Vec2::new(50.0, 0.0), ego: None, objects: &[], lights });
}

fn ids(agents: &IdmAgents) -> Vec<&str> {
    agents.agents().iter().map(|agent| &**agent.id()).collect()
}

#[test]
fn vehicles_off_the_lanes_or_in_the_way_of_others_are_no_agents() {
    let unknown = TrackedObject { velocity: Vec2::new(f64::NAN, 0.0), ..car("unknown", 90.0, 1.0, 0.0) };
    let flat = TrackedObject { length: 0.0, ..car("flat", 120.0, 1.0, 0.0) };
    let objects = [
        car("first", 20.0, 1.0, 5.0),
        car("off", 40.0, 9.0, 5.0),
        car("touching", 24.5, 2.0, 5.0),
        car("edge", 60.0, 0.0, 5.0),
        unknown,
        flat,
    ];
    let ego = SeenEgo { footprint: car("", 180.0, 1.75, 0.0).footprint(), heading: 0.0, speed: 7.0 };
    let agents = IdmAgents::new(Arc::new(free(None)), PARAMETERS, &objects, Some(&ego));
    assert_eq!(ids(&agents), ["first", "unknown"]);
    assert_eq!(agents.agents()[0].pose().position, Vec2::new(20.0, 1.75));
    assert_eq!(agents.agents()[1].speed(), 7.0);
}

#[test]
fn lanes_without_a_limit_have_the_limit_seen_last() {
    let parts = [
        LanePart { limit: Some(7.0), ..LanePart::new("limited") },
        LanePart { bottom: 3.5, ..LanePart::new("free") },
    ];
    let objects = [car("a", 20.0, 5.0, 5.0), car("b", 20.0, 1.0, 5.0), car("c", 60.0, 5.0, 5.0)];
    let agents = on(AgentRoads::new(map(&parts), &[], Vec::new()), &objects);
    let targets: Vec<f64> = agents.agents().iter().map(IdmAgent::target_speed).collect();
    assert_eq!(targets, [10.0, 7.0, 7.0]);
}

#[test]
fn signals_are_entered_at_green_only() {
    for (state, entered) in [
        (Some(LightState::Green), true),
        (Some(LightState::Yellow), false),
        (Some(LightState::Unknown), false),
        (Some(LightState::Red), false),
        (None, false),
    ] {
        let lights: Vec<Light> = state.map(|state| Light { lane: 1, state }).into_iter().collect();
        let mut agents = on(signalled(), &[car("a", 30.0, 1.75, 8.0)]);
        step(&mut agents, &lights);
        let route: &[usize] = if entered { &[0, 1, 2] } else { &[0] };
        assert_eq!(agents.agents()[0].route(), route, "{state:?}");
    }
}

#[test]
fn a_signal_that_turns_red_stops_at_its_line() {
    let light = |state| [Light { lane: 1, state }];
    let mut agents = on(signalled(), &[car("a", 30.0, 1.75, 8.0)]);
    step(&mut agents, &light(LightState::Green));
    step(&mut agents, &light(LightState::Red));
    let lead = agents.agents()[0].lead().unwrap().clone();
    assert_eq!(lead.leader, Leader::StopLine("stop".to_owned()));
    for _ in 0..300 {
        step(&mut agents, &light(LightState::Red));
    }
    let agent = &agents.agents()[0];
    assert!(agent.speed() < 0.1 && agent.pose().position.x < 50.0 - 2.25, "{:?}", agent.object());
    // A vehicle in the connector goes on.
    let mut inside = on(signalled(), &[car("a", 54.0, 1.75, 8.0)]);
    assert!(inside.agents().is_empty(), "no outline of an intersection");
    inside = on(signalled(), &[car("a", 62.0, 1.75, 8.0)]);
    step(&mut inside, &light(LightState::Red));
    assert_eq!(inside.agents()[0].lead().unwrap().leader, Leader::PathEnd);
}

#[test]
fn vehicles_far_away_are_removed_for_good() {
    let mut agents = on(free(None), &[car("near", 20.0, 1.75, 5.0), car("far", 190.0, 1.75, 5.0)]);
    let at = |x: f64| Vec2::new(x, 0.0);
    for center in [at(50.0), at(180.0)] {
        agents.step(&Step { center, ego: None, objects: &[], lights: &[] });
    }
    assert!(agents.agents().is_empty());
}

#[test]
fn walkers_and_the_end_of_the_path_count_as_standing() {
    let walker =
        TrackedObject { kind: ObjectKind::Pedestrian, length: 0.8, ..car("walker", 60.0, 1.75, 3.0) };
    let rider = TrackedObject { kind: ObjectKind::Bicycle, ..car("rider", 45.0, 1.75, 3.0) };
    let mut agents = on(free(Some(10.0)), &[car("a", 20.0, 1.75, 10.0)]);
    let objects = [walker, rider];
    agents.step(&Step { center: Vec2::zeros(), ego: None, objects: &objects, lights: &[] });
    let lead = agents.agents()[0].lead().unwrap();
    assert_eq!((&lead.leader, lead.speed), (&Leader::Object("walker".into()), 0.0));
    assert!((lead.distance - (60.0 - 0.4 - 22.25)).abs() < 1e-9);
    step(&mut agents, &[]);
    let lead = agents.agents()[0].lead().unwrap();
    // The lane ends at 200 m, its path at the state before.
    assert_eq!((&lead.leader, lead.distance, lead.rear), (&Leader::PathEnd, 199.0 - 21.0, 2.25));
}

#[test]
fn vehicles_are_put_where_they_are_observed() {
    let mut agents = on(free(None), &[car("a", 20.0, 1.75, 5.0), car("b", 60.0, 1.75, 5.0)]);
    agents.put(&car("a", 33.0, 1.0, 4.0));
    assert_eq!(
        (agents.agents()[0].pose().position, agents.agents()[0].speed()),
        (Vec2::new(33.0, 1.75), 4.0)
    );
    agents.put(&car("a", 33.0, 8.0, 4.0));
    agents.put(&car("stranger", 33.0, 1.75, 4.0));
    assert_eq!(ids(&agents), ["b"]);
    agents.remove(&"b".into());
    assert!(agents.agents().is_empty());
}
