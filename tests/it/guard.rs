//! The guard of proposed motion: it changes nothing where nothing is needed, and avoids the AV otherwise.

use std::sync::Arc;

use reactsim::geometry::{Polygon, Vec2};
use reactsim::models::qp::{GuardSettings, guarded};
use reactsim::models::{self, Card};
use reactsim::rollout::{Av, Controller, DeviatedAv, LogAv, Request, Rollout, Settings, Simulator, roll_out};
use reactsim::scene::{AgentState, CURRENT, LoggedAgent, MapParts, Scenario};

use crate::qp::check_limits;
use crate::scenes::{bystander, car, contact, future, join, lane, line, mini, scene, straight};

fn settings() -> GuardSettings {
    let baseline = models::find("ntp-guarded").unwrap();
    let card = Card::read(baseline.id, baseline.card).unwrap();
    card.parameters["guard"].clone().try_into().unwrap()
}

fn constant_velocity() -> Box<dyn Simulator> {
    match models::find("constant-velocity").unwrap().simulator().unwrap() {
        Controller::Fair(simulator) => simulator,
        Controller::Oracle(_) => panic!("sees the future"),
    }
}

/// Rolls out a scene whose AV follows its deviation, or else its log.
fn run(controller: &Controller, scenario: &Scenario) -> Rollout {
    let av: Arc<dyn Av> = match &scenario.deviation {
        Some(d) => Arc::new(DeviatedAv::new(scenario, d.track.clone()).unwrap()),
        None => Arc::new(LogAv::new(scenario).unwrap()),
    };
    let request = Request { scenario, av: Some(av), rollout: 0 };
    roll_out(vec![request], controller, &Settings::default()).remove(0).unwrap()
}

fn guard() -> Controller {
    guarded(constant_velocity(), settings()).unwrap()
}

fn plain() -> Controller {
    Controller::Fair(constant_velocity())
}

/// A scene on a straight road.
fn on_road(agents: Vec<LoggedAgent>) -> Scenario {
    scene("guarded", agents, straight())
}

#[test]
fn an_agent_that_meets_nobody_moves_as_proposed() {
    let scenario = on_road(vec![bystander(), car("free", 0.0, 0.0, 0.0, 8.0)]);
    let (free, guarded) = (run(&plain(), &scenario), run(&guard(), &scenario));
    assert_eq!(free.tracks[1], guarded.tracks[1]);
    assert_eq!(guarded.outcomes.get("qp-as-proposed"), Some(&16), "{:?}", guarded.outcomes);
}

#[test]
fn a_corner_that_leaves_the_road_changes_the_plan() {
    // A car that drifts to the left edge, which its corner reaches long before its centre does.
    let edge = 1.75;
    let corner = |x: f64, y: f64| Vec2::new(x, y);
    let exterior =
        vec![corner(-150.0, -edge), corner(350.0, -edge), corner(350.0, edge), corner(-150.0, edge)];
    let map = MapParts { drivable_area: Some(vec![Polygon { exterior, holes: Vec::new() }]), ..straight() };
    let scenario = scene("drifts", vec![bystander(), car("drifts", 0.0, 0.0, 0.02, 8.0)], map);
    let driven = |corners: bool| {
        // With a long proposal the corner is seen to leave the road before the centre is.
        let settings = GuardSettings { corners, steps: 20, ..settings() };
        let guard = guarded(constant_velocity(), settings).unwrap();
        let rollout = run(&guard, &scenario);
        check_limits(&scenario, &rollout);
        let boxes = rollout.tracks[1].iter().flatten().map(|s| s.footprint(&scenario.start.agents[1]));
        let farthest = boxes.flat_map(|b| b.corners()).map(|c| c.y.abs()).fold(0.0, f64::max);
        (rollout.outcomes["qp-as-proposed"], farthest - edge)
    };
    let ((centre, beyond), (corners, inside)) = (driven(false), driven(true));
    assert!(corners < centre && centre < 16, "of 16 plans {corners} and {centre} are as proposed");
    assert!(beyond > 0.1 && inside < 0.02, "corners are {beyond} and {inside} m off the road");
}

#[test]
fn an_agent_halts_late_behind_a_standing_av() {
    let scenario = on_road(vec![car("av", 60.0, 0.0, 0.0, 0.0), car("comes", 0.0, 0.0, 0.0, 10.0)]);
    assert!(contact(&scenario, &run(&plain(), &scenario)).is_some());
    let rollout = run(&guard(), &scenario);
    check_limits(&scenario, &rollout);
    assert_eq!(contact(&scenario, &rollout), None);
    let states = future(&scenario, &rollout, "comes");
    // For three seconds it can still halt later. In the end a few metres are left at most.
    assert_eq!(states[30].vx, 10.0);
    let left = 60.0 - states[80].x - 4.6;
    assert!(states[80].vx < 0.1 && left > 0.2 && left < 8.0, "{left}");
}

#[test]
fn an_agent_moves_aside_for_an_av_that_comes_on_its_lane() {
    // The AV comes 1.5 m beside the agent's line: braking does not help.
    let map = MapParts {
        lanes: vec![
            lane("main", line((-150.0, 0.0), (350.0, 0.0)), Some(15.0)),
            lane("shoulder", line((-150.0, -3.0), (350.0, -3.0)), Some(15.0)),
        ],
        ..MapParts::default()
    };
    let comes = car("av", 110.0, 1.5, std::f64::consts::PI, 8.0);
    let scenario = scene("oncoming", vec![comes, car("meets", 0.0, 0.0, 0.0, 8.0)], map);
    assert!(contact(&scenario, &run(&plain(), &scenario)).is_some());
    let rollout = run(&guard(), &scenario);
    check_limits(&scenario, &rollout);
    assert_eq!(contact(&scenario, &rollout), None);
    let states = future(&scenario, &rollout, "meets");
    let aside = states.iter().map(|s| s.y).fold(f64::INFINITY, f64::min);
    assert!(aside < -0.5 && aside > -6.0, "{aside}");
    assert!(states[80].x > 30.0, "{:?}", states[80]);
}

#[test]
fn an_agent_gives_way_to_an_av_that_may_turn_across() {
    // The AV comes towards the agent and turns left; for a long time only its lanes tell that it may.
    let mut lanes = vec![
        lane("main", line((-150.0, 0.0), (350.0, 0.0)), Some(15.0)),
        lane("back", line((350.0, 3.5), (50.0, 3.5)), Some(15.0)),
        lane("on", line((50.0, 3.5), (-150.0, 3.5)), Some(15.0)),
        lane("left", line((50.0, 3.5), (40.0, -40.0)), Some(15.0)),
    ];
    join(&mut lanes, "back", "on");
    join(&mut lanes, "back", "left");
    let map = MapParts { lanes, ..MapParts::default() };
    let mut av = car("av", 56.0, 3.5, std::f64::consts::PI, 2.0);
    let turned = |k: usize| {
        // 2 m/s to the corner, then across the main lane.
        let way = 0.2 * k as f64;
        let (dx, dy) = (-10.0 / 44.6, -43.5 / 44.6);
        let heading = f64::atan2(dy, dx);
        let on = (way - 6.0).max(0.0);
        match on > 0.0 {
            true => AgentState { x: 50.0 + dx * on, y: 3.5 + dy * on, heading, vx: 2.0 * dx, vy: 2.0 * dy },
            false => AgentState { x: 56.0 - way, y: 3.5, heading: std::f64::consts::PI, vx: -2.0, vy: 0.0 },
        }
    };
    for k in 1..=80 {
        av.track[CURRENT + k] = Some(turned(k));
    }
    let scenario = scene("turns", vec![av, car("comes", 12.0, 0.0, 0.0, 8.0)], map);
    let rollout = run(&guard(), &scenario);
    check_limits(&scenario, &rollout);
    assert_eq!(contact(&scenario, &rollout), None);
}

#[test]
fn the_guard_keeps_limits() {
    for scenario in &mini() {
        check_limits(scenario, &run(&guard(), scenario));
    }
}
