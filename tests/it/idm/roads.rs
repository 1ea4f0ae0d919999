//! Curves, ends of roads, and routes at forks.

use std::f64::consts::FRAC_PI_2;

use reactsim::geometry::{Vec2, wrap};
use reactsim::rollout::Settings;
use reactsim::scene::{AgentState, DT, FUTURE, HISTORY, MapParts, Scenario};

use crate::scenes::{
    arc, bits, bystander, car, coasting, future, idm, join, lane, line, parts, roll_with, scene,
};

/// Returns a straight approach to the origin, a left curve of 90 degrees, and a straight exit.
fn bend(radius: f64) -> MapParts {
    let curve = arc((0.0, 0.0), 0.0, radius, FRAC_PI_2);
    let end = curve[curve.len() - 1];
    let mut lanes = vec![
        lane("approach", line((-150.0, 0.0), (0.0, 0.0)), Some(15.0)),
        lane("curve", curve, Some(15.0)),
        lane("exit", line((end.x, end.y), (end.x, end.y + 150.0)), Some(15.0)),
    ];
    join(&mut lanes, "approach", "curve");
    join(&mut lanes, "curve", "exit");
    MapParts { lanes, ..MapParts::default() }
}

/// Returns the largest lateral acceleration along a track, m/s².
fn lateral(track: &[AgentState]) -> f64 {
    let bends = track.windows(2).map(|w| (wrap(w[1].heading - w[0].heading) / DT * w[1].speed()).abs());
    bends.fold(0.0, f64::max)
}

#[test]
fn curves_are_taken_at_a_speed_that_people_bear() {
    for radius in [10.0, 15.0, 25.0, 45.0] {
        for speed in [6.0, 10.0, 14.0] {
            let id = format!("radius {radius}, {speed} m/s");
            let scenario = scene(&id, vec![bystander(), car("own", -45.0, 0.0, 0.0, speed)], bend(radius));
            let track = future(&scenario, &idm(&scenario), "own");
            let a = lateral(&track);
            assert!(a < 3.5, "{id}: {a:.2} m/s2 sideways");
            let road = scenario.start.road();
            let off = |s: &AgentState| {
                let hits = (0..3).map(|l| road.lane(l).baseline.project(s.position()).distance);
                hits.fold(f64::INFINITY, f64::min)
            };
            let worst = track.iter().map(off).fold(0.0, f64::max);
            assert!(worst < 1.0, "{id}: {worst:.2} m off the lane");
            if radius < 20.0 && speed > 12.0 {
                let slowest = track.iter().map(AgentState::speed).fold(f64::INFINITY, f64::min);
                assert!(slowest < 8.5, "{id}: never slower than {slowest:.1} m/s");
            }
        }
    }
}

#[test]
fn who_starts_in_a_curve_follows_it() {
    let radius = 20.0;
    let (angle, speed) = (0.6_f64, 6.0);
    let mut own = car("own", radius * angle.sin(), radius * (1.0 - angle.cos()), angle, speed);
    for (f, state) in own.track.iter_mut().enumerate() {
        let h = angle + (f as f64 - 10.0) * DT * speed / radius;
        *state = Some(crate::scenes::state(radius * h.sin(), radius * (1.0 - h.cos()), h, speed));
    }
    let scenario = scene("in a curve", vec![bystander(), own], bend(radius));
    let track = future(&scenario, &idm(&scenario), "own");
    let road = scenario.start.road();
    for s in &track {
        let off = (0..3)
            .map(|l| road.lane(l).baseline.project(s.position()).distance)
            .fold(f64::INFINITY, f64::min);
        assert!(off < 0.8, "{off:.2} m off the lane");
    }
}

/// Returns a lane that splits into two similar ones.
fn fork() -> MapParts {
    let branch = |side: f64| {
        let mut points = arc((60.0, 0.0), 0.0, 60.0, 0.35 * side);
        let last = points[points.len() - 1];
        let away = Vec2::new((0.35 * side).cos(), (0.35 * side).sin());
        points.extend((1..60).map(|k| last + away * (2.0 * f64::from(k))));
        points
    };
    let mut lanes = vec![
        lane("stem", line((-100.0, 0.0), (60.0, 0.0)), Some(12.0)),
        lane("left", branch(1.0), Some(12.0)),
        lane("right", branch(-1.0), Some(12.0)),
    ];
    join(&mut lanes, "stem", "left");
    join(&mut lanes, "stem", "right");
    MapParts { lanes, ..MapParts::default() }
}

#[test]
fn routes_are_drawn_from_the_named_stream() {
    let scenario = scene("fork", vec![bystander(), car("own", 10.0, 0.0, 0.0, 11.0)], fork());
    let end = |seed: u64, rollout: u32| {
        let settings = Settings { seed, ..Settings::default() };
        let rollout = roll_with("idm", &scenario, coasting(&scenario), &settings, rollout);
        future(&scenario, &rollout, "own")[FUTURE].y
    };
    for (name, ends) in [
        ("seeds", (0..40).map(|seed| end(seed, 0)).collect::<Vec<f64>>()),
        ("rollouts", (0..40).map(|rollout| end(0, rollout)).collect()),
    ] {
        let left = ends.iter().filter(|y| **y > 2.0).count();
        let right = ends.iter().filter(|y| **y < -2.0).count();
        assert_eq!(left + right, 40, "{name}: all take a branch: {ends:?}");
        assert!(left >= 8 && right >= 8, "{name}: {left} left, {right} right of 40");
    }
    assert_eq!(end(5, 2), end(5, 2));
}

#[test]
fn routes_do_not_come_from_the_future() {
    for seed in 0..6 {
        let of = |turn: f64| {
            let mut own = car("own", 10.0, 0.0, 0.0, 11.0);
            for (k, state) in own.track[HISTORY..].iter_mut().flatten().enumerate() {
                state.y = turn * k as f64;
                state.heading = turn;
            }
            let scenario = Scenario::assemble(parts("fork", vec![bystander(), own], fork())).unwrap();
            let settings = Settings { seed, ..Settings::default() };
            bits(&roll_with("idm", &scenario, coasting(&scenario), &settings, 0).tracks)
        };
        assert!(of(0.3) == of(-0.3), "seed {seed}: the log's turn shows in the route");
    }
}

#[test]
fn who_already_turns_takes_the_turn() {
    // At the fork and turning left: the motion decides the branch, whatever the seed.
    let mut own = car("own", 70.0, 0.0, 0.0, 8.0);
    for (f, state) in own.track.iter_mut().enumerate() {
        let gone = 10.0 + (f as f64 - 10.0) * DT * 8.0;
        let h = (gone / 60.0).max(0.0);
        let (x, y) = if gone > 0.0 { (60.0 * h.sin(), 60.0 * (1.0 - h.cos())) } else { (gone, 0.0) };
        *state = Some(crate::scenes::state(60.0 + x, y, h, 8.0));
    }
    let scenario = scene("turning", vec![bystander(), own], fork());
    let left = (0..20).filter(|&seed| {
        let settings = Settings { seed, ..Settings::default() };
        let rollout = roll_with("idm", &scenario, coasting(&scenario), &settings, 0);
        future(&scenario, &rollout, "own")[FUTURE].y > 3.0
    });
    assert!(left.count() >= 18);
}

#[test]
fn where_the_road_ends_nothing_breaks() {
    let map = MapParts {
        lanes: vec![lane("stub", line((-50.0, 0.0), (30.0, 0.0)), Some(12.0))],
        ..MapParts::default()
    };
    for speed in [0.0, 5.0, 12.0, 25.0] {
        let scenario = scene("stub", vec![bystander(), car("own", 0.0, 0.0, 0.0, speed)], map.clone());
        let track = future(&scenario, &idm(&scenario), "own");
        let aside = track.iter().map(|s| s.y.abs()).fold(0.0, f64::max);
        assert!(aside < 1.0, "{speed} m/s: {aside:.1} m off its course, {:?}", track[FUTURE]);
    }
}
