//! Every filter with a candidate that passes and one that does not.

use reactsim::curation::{Candidate, FILTERS, FilterContext, FilterSettings, Trial, Verdict};
use reactsim::scene::{AgentKind, CURRENT, FRAMES, LightState, LoggedAgent, Scenario};

use super::road::{braked, candidate, map, on_road};
use crate::scenes::{agent, car, lane, light, line, parts, scene, state};

fn verdict(filter: &str, scenario: &Scenario, candidate: &Candidate, settings: &FilterSettings) -> Verdict {
    let context = FilterContext::new(scenario).unwrap();
    let trial = Trial::new(&context, candidate, settings);
    (FILTERS.iter().find(|f| f.id == filter).unwrap().judge)(&trial)
}

#[track_caller]
fn passes(filter: &str, scenario: &Scenario, candidate: &Candidate) -> Option<f64> {
    let verdict = verdict(filter, scenario, candidate, &FilterSettings::default());
    assert_eq!(verdict.rejected, None);
    verdict.figure
}

#[track_caller]
fn rejects(filter: &str, scenario: &Scenario, candidate: &Candidate, reason: &str) -> Option<f64> {
    let verdict = verdict(filter, scenario, candidate, &FilterSettings::default());
    assert_eq!(verdict.rejected.as_deref(), Some(reason));
    verdict.figure
}

fn av() -> LoggedAgent {
    car("av", 0.0, 0.0, 0.0, 10.0)
}

fn alone() -> Scenario {
    on_road("alone", vec![av()])
}

/// Returns a candidate that keeps 10 m/s.
fn steady(scenario: &Scenario) -> Candidate {
    candidate(scenario, |t| (10.0 * t, 0.0, 0.0))
}

/// Returns a candidate that stops at a deceleration.
fn stopping(scenario: &Scenario, loss: f64) -> Candidate {
    candidate(scenario, |t| (braked(10.0, loss, t), 0.0, 0.0))
}

/// Returns a candidate that stands at x = 0 from the start on.
fn standing(scenario: &Scenario) -> Candidate {
    candidate(scenario, |_| (0.0, 0.0, 0.0))
}

#[test]
fn ids_are_unique_and_avoidability_is_last() {
    let ids: std::collections::BTreeSet<_> = FILTERS.iter().map(|f| f.id).collect();
    assert_eq!(ids.len(), FILTERS.len());
    assert_eq!(FILTERS.last().unwrap().id, "avoidable");
    for filter in FILTERS {
        assert!(!(filter.rule)(&FilterSettings::default()).is_empty());
    }
}

#[test]
fn log_distance() {
    let scenario = alone();
    assert_eq!(
        rejects("log-distance", &scenario, &steady(&scenario), "only 0.00 m from the log on average"),
        Some(0.0)
    );
    // 2 m to the side from the first step on: exactly at the limit.
    let beside = candidate(&scenario, |t| (10.0 * t, 2.0, 0.0));
    assert_eq!(passes("log-distance", &scenario, &beside), Some(2.0));
}

#[test]
fn drivable_area() {
    let scenario = alone();
    assert_eq!(passes("drivable-area", &scenario, &steady(&scenario)), Some(0.0));
    // Half of the width is 0.95 m: corners at -2.25 are 0.25 m off, within the tolerance; at -2.35 they are
    // not.
    let close = candidate(&scenario, |t| (10.0 * t, -1.3, 0.0));
    assert!((passes("drivable-area", &scenario, &close).unwrap() - 0.25).abs() < 1e-9);
    let off = candidate(&scenario, |t| (10.0 * t, -1.4, 0.0));
    rejects("drivable-area", &scenario, &off, "a corner is 0.35 m off the road");
}

#[test]
fn kinematics() {
    let scenario = alone();
    assert_eq!(passes("kinematics", &scenario, &stopping(&scenario, 5.0)), Some(0.0));
    let hard = verdict("kinematics", &scenario, &stopping(&scenario, 8.0), &FilterSettings::default());
    assert!(hard.rejected.unwrap().starts_with("12 infeasible accelerations, 0"), "{:?}", hard.figure);
    // A turn of 0.5 rad within a metre.
    let kink = candidate(&scenario, |t| (10.0 * t, 0.0, if t > 2.0 { 0.5 } else { 0.0 }));
    rejects("kinematics", &scenario, &kink, "0 infeasible accelerations, 1 infeasible curvatures");
}

#[test]
fn lateral_acceleration() {
    let scenario = alone();
    // On a circle of 25 m at 10 m/s: 4 m/s²; of 20 m: 5 m/s².
    let circling = |r: f64| {
        let turned = move |t: f64| 10.0 * t / r;
        candidate(&scenario, move |t| (r * turned(t).sin(), r * (1.0 - turned(t).cos()), turned(t)))
    };
    assert!((passes("lateral-acceleration", &scenario, &circling(25.0)).unwrap() - 4.0).abs() < 0.01);
    rejects("lateral-acceleration", &scenario, &circling(20.0), "lateral acceleration of 5.0 m/s²");
}

#[test]
fn comfort_is_an_option() {
    let scenario = alone();
    let hard = stopping(&scenario, 5.5);
    assert!(passes("comfort", &scenario, &hard).unwrap() > 1.3);
    let strict = FilterSettings { comfort: true, ..FilterSettings::default() };
    let why = verdict("comfort", &scenario, &hard, &strict).rejected.unwrap();
    assert!(why.contains("of the bound"), "{why}");
    assert_eq!(verdict("comfort", &scenario, &steady(&scenario), &strict).rejected, None);
}

#[test]
fn wrong_way() {
    let scenario = alone();
    passes("wrong-way", &scenario, &candidate(&scenario, |t| (10.0 * t, 3.5, 0.0)));
    let against = candidate(&scenario, |t| (10.0 * t, 7.0, 0.0));
    rejects("wrong-way", &scenario, &against, "drives against its lane");
}

#[test]
fn red_light() {
    let lit = |shows: fn(usize) -> LightState, av: LoggedAgent| {
        let mut parts = parts("lit", vec![av], map());
        parts.lights = vec![light("right", (30.0, 0.0), shows)];
        Scenario::assemble(parts).unwrap()
    };
    // The logged AV waits before the line; the front of the candidate passes it after (30 - 2.3) / 10 s.
    let waiting = || car("av", 20.0, 0.0, 0.0, 0.0);
    let red = lit(|_| LightState::Stop, waiting());
    let goes = candidate(&red, |t| (20.0 + 10.0 * t, 0.0, 0.0));
    rejects("red-light", &red, &goes, "runs a red light after 0.8 s");
    passes("red-light", &red, &candidate(&red, |_| (20.0, 0.0, 0.0)));
    let green = lit(|f| if f < CURRENT + 5 { LightState::Stop } else { LightState::Go }, waiting());
    passes("red-light", &green, &goes);
    // If two lanes cross the line together, a light of unknown colour on one of them does not permit passing.
    let mut both = parts("both", vec![waiting()], map());
    both.map.lanes.push(lane("twin", line((20.0, 0.2), (400.0, 0.2)), None));
    let shown = |twin: LightState| {
        let mut both = both.clone();
        both.lights = vec![
            light("right", (30.0, 0.0), |_| LightState::Stop),
            light("twin", (30.0, 0.2), move |_| twin),
        ];
        Scenario::assemble(both).unwrap()
    };
    rejects("red-light", &shown(LightState::Unknown), &goes, "runs a red light after 0.8 s");
    passes("red-light", &shown(LightState::Go), &goes);
    // If the logged AV runs the red light too, the light is taken to be wrong.
    let ran = lit(|_| LightState::Stop, car("av", 0.0, 0.0, 0.0, 10.0));
    passes("red-light", &ran, &stopping(&ran, 1.0));
}

#[test]
fn pressure() {
    let pressed = on_road("pressed", vec![av(), car("follower", -15.0, 0.0, 0.0, 10.0)]);
    assert_eq!(passes("pressure", &pressed, &stopping(&pressed, 3.0)), Some(0.0));
    assert_eq!(rejects("pressure", &pressed, &steady(&pressed), "nobody has to react"), Some(5.0));
    let scenario = alone();
    assert_eq!(rejects("pressure", &scenario, &steady(&scenario), "nobody has to react"), None);
}

#[test]
fn early_contact() {
    // The gap is 15 - 4.6 = 10.4 m: at 13 m/s it is closed after 0.8 s, at 10 m/s later.
    let fast = on_road("fast", vec![av(), car("follower", -15.0, 0.0, 0.0, 13.1)]);
    let time = rejects("early-contact", &fast, &standing(&fast), "contact after 0.8 s").unwrap();
    assert!((time - 0.8).abs() < 1e-9);
    let slow = on_road("slow", vec![av(), car("follower", -15.0, 0.0, 0.0, 10.0)]);
    assert!(passes("early-contact", &slow, &standing(&slow)).unwrap() > 1.0);
    assert_eq!(passes("early-contact", &alone(), &standing(&alone())), None);
}

#[test]
fn active_collision() {
    let into = |other: LoggedAgent, reason: &str| {
        let scenario = on_road("into", vec![av(), other]);
        let why = verdict("active-collision", &scenario, &steady(&scenario), &FilterSettings::default());
        assert!(why.rejected.as_deref().is_some_and(|w| w.starts_with(reason)), "{why:?}");
    };
    into(car("parked", 40.0, 0.0, 1.5, 0.0), "touches a standing vehicle");
    into(car("beside", 40.0, 1.8, 0.0, 0.0), "touches a standing vehicle");
    into(car("crawling", 40.0, 1.5, 3.0, 0.3), "touches a vehicle at 0.3 m/s");
    into(car("slow", 40.0, -5.0, 1.5, 1.5), "drives into a vehicle at 1.5 m/s");
    into(car("towards", 60.0, 0.0, std::f64::consts::PI, 5.0), "drives head on into a vehicle");
    into(car("slower", 30.0, 0.0, 0.0, 4.0), "drives into a vehicle ahead");
    into(agent("walker", AgentKind::Pedestrian, state(40.0, 0.0, 1.5, 0.0)), "touches a pedestrian");
    into(agent("rider", AgentKind::Cyclist, state(40.0, 0.0, 0.0, 3.0)), "touches a cyclist");
    into(agent("cone", AgentKind::Other, state(40.0, 0.0, 0.0, 0.0)), "drives into an obstacle");
    // An agent that runs into the AV, or meets it crossing, is under pressure; the AV does not drive into it.
    let behind = on_road("behind", vec![av(), car("follower", -15.0, 0.0, 0.0, 10.0)]);
    passes("active-collision", &behind, &stopping(&behind, 3.0));
    let crossing = on_road("crossing", vec![av(), car("crosser", 40.0, -40.0, 1.57, 10.0)]);
    passes("active-collision", &crossing, &steady(&crossing));
}

#[test]
fn avoidable() {
    let far = on_road("far", vec![av(), car("follower", -20.0, 0.0, 0.0, 10.0)]);
    let peak = passes("avoidable", &far, &stopping(&far, 3.0)).unwrap();
    assert!(peak > 1.0 && peak <= 5.0, "{peak}");
    let near = on_road("near", vec![av(), car("follower", -7.0, 0.0, 0.0, 14.0)]);
    let verdict = verdict("avoidable", &near, &stopping(&near, 5.0), &FilterSettings::default());
    assert!(verdict.rejected.unwrap().contains("follower"));
}

#[test]
fn an_absent_log_is_refused() {
    let mut gone = av();
    gone.track[FRAMES - 1] = None;
    assert!(FilterContext::new(&scene("gone", vec![gone], map())).is_err());
}

#[test]
fn unknown_velocities_are_position_differences() {
    let mut parked = car("parked", 40.0, 0.0, 1.5, 0.0);
    for state in parked.track.iter_mut().flatten() {
        (state.vx, state.vy) = (f64::NAN, f64::NAN);
    }
    let scenario = on_road("unknown", vec![av(), parked]);
    let why = verdict("active-collision", &scenario, &steady(&scenario), &FilterSettings::default());
    assert!(why.rejected.is_some_and(|w| w.starts_with("touches a standing vehicle")));
}
