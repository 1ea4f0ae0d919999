//! Lights and stop signs.

use reactsim::geometry::Vec2;
use reactsim::scene::{AgentState, CURRENT, FUTURE, LightState, Scenario, StopKind, StopLineParts};

use super::{braking_within_limits, no_contact};
use crate::scenes::{bystander, car, idm, light, parts, straight};

/// Position of the line, metres.
const LINE: f64 = 50.0;
/// Half the length of a car, metres.
const HALF: f64 = 2.3;

/// Returns a scene with one vehicle whose front is `ahead` metres before a stop line.
fn at_a_line(
    id: &str,
    ahead: f64,
    speed: f64,
    kind: StopKind,
    shows: Option<&dyn Fn(usize) -> LightState>,
) -> Scenario {
    let mut map = straight();
    map.stop_lines.push(StopLineParts { kind, lane: "main".into(), at: Vec2::new(LINE, 0.0) });
    let own = car("own", LINE - HALF - ahead, 0.0, 0.0, speed);
    let mut parts = parts(id, vec![bystander(), own], map);
    if let Some(shows) = shows {
        parts.lights.push(light("main", (LINE, 0.0), shows));
    }
    Scenario::assemble(parts).unwrap()
}

/// Returns the first step at which the front is beyond the line.
fn crosses(track: &[AgentState]) -> Option<usize> {
    track.iter().position(|s| s.x + HALF > LINE + 0.05)
}

#[test]
fn waits_at_red_and_goes_at_green() {
    for red in [LightState::Stop, LightState::ArrowStop] {
        for (ahead, speed) in [(45.0, 13.0), (30.0, 10.0), (12.0, 5.0), (1.5, 0.0)] {
            let green = CURRENT + 45;
            let shows = |f| if f < green { red } else { LightState::Go };
            let id = format!("{red:?} {ahead} m ahead");
            let scenario = at_a_line(&id, ahead, speed, StopKind::Light, Some(&shows));
            let track = braking_within_limits(&scenario, &idm(&scenario), "own");
            let crossed = crosses(&track);
            assert!(crossed.is_some_and(|k| k > 45), "{id}: crosses at step {crossed:?}, green from 45");
            assert!(track[FUTURE].speed() > 3.0, "{id}: {:.1} m/s after green", track[FUTURE].speed());
        }
    }
}

#[test]
fn stays_at_red_near_the_line() {
    let scenario = at_a_line("red", 45.0, 13.0, StopKind::Light, Some(&|_| LightState::Stop));
    let track = braking_within_limits(&scenario, &idm(&scenario), "own");
    assert_eq!(crosses(&track), None);
    let left = LINE - track[FUTURE].x - HALF;
    assert!(left < 5.0 && track[FUTURE].speed() < 0.5, "{left:.1} m before the line");
}

#[test]
fn a_light_out_of_sight_keeps_its_colour() {
    let mut scenario = at_a_line("unseen", 30.0, 10.0, StopKind::Light, Some(&|_| LightState::Stop));
    scenario.log_future.lights[0].fill(None);
    assert_eq!(crosses(&braking_within_limits(&scenario, &idm(&scenario), "own")), None);
}

#[test]
fn stops_at_yellow_where_it_can_and_else_goes_on() {
    for yellow in [LightState::Caution, LightState::ArrowCaution] {
        let shows = |f| if f < CURRENT + 30 { yellow } else { LightState::Stop };
        let far = at_a_line("yellow, far", 45.0, 12.0, StopKind::Light, Some(&shows));
        assert_eq!(crosses(&braking_within_limits(&far, &idm(&far), "own")), None, "there was room to stop");
        let near = at_a_line("yellow, near", 8.0, 14.0, StopKind::Light, Some(&shows));
        let track = braking_within_limits(&near, &idm(&near), "own");
        assert!(crosses(&track).is_some_and(|k| k < 10), "it could not stop any more");
        let slowest = track.iter().map(AgentState::speed).fold(f64::INFINITY, f64::min);
        assert!(slowest > 10.0, "nobody brakes beyond the line: {slowest:.1} m/s");
    }
}

#[test]
fn green_and_flashing_yellow_are_passed() {
    for colour in [LightState::Go, LightState::ArrowGo, LightState::FlashingCaution] {
        let scenario = at_a_line("pass", 40.0, 13.0, StopKind::Light, Some(&|_| colour));
        let track = braking_within_limits(&scenario, &idm(&scenario), "own");
        let slowest = track.iter().map(AgentState::speed).fold(f64::INFINITY, f64::min);
        assert!(crosses(&track).is_some_and(|k| k < 40) && slowest > 12.0, "{colour:?}: {slowest:.1} m/s");
    }
}

#[test]
fn stops_at_a_stop_sign_and_goes() {
    for (ahead, speed) in [(24.0, 9.0), (15.0, 6.0), (8.0, 3.0)] {
        for (kind, shows) in [(StopKind::Sign, None), (StopKind::Light, Some(LightState::FlashingStop))] {
            let shows = shows.map(|s| move |_: usize| s);
            let id = format!("{kind:?} {ahead} m ahead");
            let shows = shows.as_ref().map(|s| s as &dyn Fn(usize) -> LightState);
            let scenario = at_a_line(&id, ahead, speed, kind, shows);
            let track = braking_within_limits(&scenario, &idm(&scenario), "own");
            let stopped = track.iter().position(|s| s.speed() < 0.35);
            let crossed = crosses(&track);
            let (Some(stopped), Some(crossed)) = (stopped, crossed) else {
                panic!("{id}: stops at {stopped:?}, crosses at {crossed:?}; ends at {:?}", track[FUTURE])
            };
            assert!(stopped < crossed, "{id}: crosses at {crossed}, stops at {stopped}");
            let left = LINE - track[stopped].x - HALF;
            assert!(left < 3.5, "{id}: stops {left:.1} m before the line");
        }
    }
}

#[test]
fn who_is_beyond_the_line_drives_on() {
    let scenario = at_a_line("beyond", -1.0, 8.0, StopKind::Light, Some(&|_| LightState::Stop));
    let track = braking_within_limits(&scenario, &idm(&scenario), "own");
    assert!(track[FUTURE].x > LINE + 40.0, "stops in the junction at x = {:.1}", track[FUTURE].x);
}

#[test]
fn a_queue_at_a_light_stops_and_starts() {
    let mut map = straight();
    map.stop_lines.push(StopLineParts {
        kind: StopKind::Light,
        lane: "main".into(),
        at: Vec2::new(LINE, 0.0),
    });
    let mut agents = vec![bystander()];
    for k in 0..4 {
        agents.push(car(&format!("q{k}"), LINE - HALF - 20.0 - 18.0 * f64::from(k), 0.0, 0.0, 10.0));
    }
    let mut parts = parts("queue at a light", agents, map);
    let shows = |f| if f < CURRENT + 40 { LightState::Stop } else { LightState::Go };
    parts.lights.push(light("main", (LINE, 0.0), shows));
    let scenario = Scenario::assemble(parts).unwrap();
    let rollout = idm(&scenario);
    no_contact(&scenario, &rollout);
    for k in 0..4 {
        let track = braking_within_limits(&scenario, &rollout, &format!("q{k}"));
        assert!(track[FUTURE].speed() > 1.0, "q{k} has not started");
    }
}
