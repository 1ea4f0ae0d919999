//! AVs that back up: what moves, moves where it moves, not where it heads.

use std::f64::consts::FRAC_PI_2;

use reactsim::models;
use reactsim::scene::{AgentState, DT, FUTURE, MapParts, Scenario};

use crate::scenes::{car, contact, lane, line, roll, scene, scores, straight};

/// Baselines with rules or a guard.
const RULES: [&str; 4] = ["idm", "idm+qp", "ntp-guarded", "qp-regression"];

/// Returns 80 states of an AV that starts at `now` and drives with the speeds `speed(t)`, m/s, negative in
/// reverse, at a curvature, 1/m.
fn driven(now: AgentState, curvature: f64, speed: impl Fn(f64) -> f64) -> Vec<AgentState> {
    let mut last = now;
    let step = |k: usize| {
        let v = speed(DT * k as f64);
        let heading = last.heading + curvature * v * DT;
        let (vx, vy) = (v * heading.cos(), v * heading.sin());
        last = AgentState { x: last.x + vx * DT, y: last.y + vy * DT, heading, vx, vy };
        last
    };
    (1..=FUTURE).map(step).collect()
}

/// Reverses from a time on, gaining speed by 1.5 m/s².
fn from(start: f64, most: f64) -> impl Fn(f64) -> f64 {
    move |t| -(1.5 * (t - start)).clamp(0.0, most)
}

fn check(id: &str, scenario: &Scenario, av: Vec<AgentState>) {
    let (name, stage) =
        models::qp::Smoothing::of_id(id).map_or((id, None), |(name, stage)| (name, Some(stage)));
    let baseline = models::find(name).unwrap();
    let mut controller = baseline.simulator().unwrap();
    if let Some(stage) = stage {
        controller = stage.behind(baseline.id, controller).unwrap();
    }
    for every in [1, 5] {
        let settings = super::settings(every, true);
        let done = roll(scenario, av.clone(), &controller, &settings);
        let faults = scores(scenario, &done).value("aav-collision");
        assert_eq!(faults, Some(0.0), "{id} every {every}: {}: {:?}", scenario.id, contact(scenario, &done));
    }
}

#[test]
fn an_av_that_backs_up_in_the_lane_is_waited_for() {
    for id in RULES {
        for speed in [0.5, 1.0, 2.0, 3.5, 5.0] {
            let agents = vec![car("av", 55.0, 0.0, 0.0, -speed), car("behind", 0.0, 0.0, 0.0, 10.0)];
            let scenario = scene(&format!("backs at {speed} m/s"), agents, straight());
            check(id, &scenario, driven(scenario.start.now(0), 0.0, |_| -speed));
        }
    }
}

#[test]
fn an_av_that_begins_to_back_up_is_waited_for() {
    for id in RULES {
        for (begins, most) in [(1.0, 2.0), (2.5, 1.0), (2.5, 4.0), (5.0, 2.0)] {
            let agents = vec![car("av", 60.0, 0.0, 0.0, 0.0), car("behind", 0.0, 0.0, 0.0, 10.0)];
            let scenario = scene(&format!("backs at {most} m/s from {begins} s on"), agents, straight());
            check(id, &scenario, driven(scenario.start.now(0), 0.0, from(begins, most)));
        }
        // It drives ahead at first.
        let agents = vec![car("av", 25.0, 0.0, 0.0, 8.0), car("behind", 0.0, 0.0, 0.0, 8.0)];
        let scenario = scene("brakes, then backs", agents, straight());
        check(id, &scenario, driven(scenario.start.now(0), 0.0, |t| (8.0 - 3.0 * t).max(-2.0)));
    }
}

#[test]
fn an_av_that_backs_out_of_a_drive_is_given_way() {
    for id in RULES {
        for (speed, aside) in [(1.0, 6.0), (2.0, 8.0), (3.0, 9.0)] {
            let mut lanes = straight().lanes;
            lanes.push(lane("drive", line((60.0, 30.0), (60.0, 0.0)), Some(5.0)));
            let map = MapParts { lanes, ..MapParts::default() };
            let agents = vec![car("av", 60.0, aside, FRAC_PI_2, -speed), car("comes", 0.0, 0.0, 0.0, 10.0)];
            let scenario = scene(&format!("backs out at {speed} m/s"), agents, map);
            // It turns into the lane, stops, and drives off along it.
            let speed = |t: f64| if t < 6.0 { -speed } else { (t - 6.0).min(3.0) };
            check(id, &scenario, driven(scenario.start.now(0), 1.0 / 8.0, speed));
        }
    }
}

#[test]
fn an_av_that_backs_away_leads() {
    for id in RULES {
        let agents =
            vec![car("av", 20.0, 0.0, std::f64::consts::PI, -5.0), car("behind", 0.0, 0.0, 0.0, 8.0)];
        let scenario = scene("backs away", agents, straight());
        check(id, &scenario, driven(scenario.start.now(0), 0.0, |_| -5.0));
    }
}
