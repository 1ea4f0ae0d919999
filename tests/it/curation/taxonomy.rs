//! The category of hand-made trajectories of each kind, and of mixed ones.

use std::f64::consts::FRAC_PI_2;

use reactsim::curation::{Conflict, Taxonomy, classify};
use reactsim::geometry::{OrientedBox, Polyline, Vec2};
use reactsim::scene::{AgentState, DT, Deviation, FUTURE, MapParts, Scenario};

use super::road::braked;
use crate::scenes::{arc, car, join, lane, line, scene, state};

/// Returns a lane that forks at x = 30: straight on, or to the left on a radius of 12 m; and another lane
/// next to it.
fn fork() -> Scenario {
    let turn = arc((30.0, 0.0), 0.0, 12.0, FRAC_PI_2);
    let mut lanes = vec![
        lane("in", line((-100.0, 0.0), (30.0, 0.0)), None),
        lane("on", line((30.0, 0.0), (200.0, 0.0)), None),
        lane("turn", turn.into_iter().chain(line((42.0, 14.0), (42.0, 100.0))).collect(), None),
        lane("beside", line((-100.0, -3.5), (200.0, -3.5)), None),
    ];
    join(&mut lanes, "in", "on");
    join(&mut lanes, "in", "turn");
    scene("fork", vec![car("av", 0.0, 0.0, 0.0, 8.0)], MapParts { lanes, ..MapParts::default() })
}

/// Returns states at the steps 0 to 80 along a line; `way` is the distance by time.
fn along(points: &[Vec2], way: impl Fn(f64) -> f64) -> Vec<AgentState> {
    let line = Polyline::new(points).unwrap();
    let at = |k: usize| {
        let s = way(k as f64 * DT);
        let p = line.at(s);
        state(p.x, p.y, line.heading_at(s), 8.0)
    };
    (0..=FUTURE).map(at).collect()
}

fn straight() -> Vec<Vec2> {
    line((0.0, 0.0), (200.0, 0.0))
}

fn turning() -> Vec<Vec2> {
    let mut points = line((0.0, 0.0), (30.0, 0.0));
    points.extend(arc((30.0, 0.0), 0.0, 12.0, FRAC_PI_2).into_iter().skip(1));
    points.extend(line((42.0, 14.0), (42.0, 100.0)));
    points
}

/// Returns a change to the adjacent lane, over 20 m from x = 10.
fn changing() -> Vec<Vec2> {
    let mut points = line((0.0, 0.0), (10.0, 0.0));
    points.extend((1..=20).map(|i| {
        let u = f64::from(i) / 20.0;
        Vec2::new(10.0 + f64::from(i), -3.5 * u * u * (3.0 - 2.0 * u))
    }));
    points.extend(line((31.0, -3.5), (200.0, -3.5)));
    points
}

fn read(logged: &[Vec2], track: &[AgentState], conflict: Option<usize>) -> Taxonomy {
    let scenario = fork();
    let log = along(logged, |t| 8.0 * t);
    let conflict = conflict.map(|step| Conflict { step, touched: None });
    let (way, av) = (Polyline::new(logged).unwrap(), &scenario.start.agents[0]);
    classify(&scenario.start.road(), &way, &log, track, av, conflict)
}

#[test]
fn another_speed_is_longitudinal() {
    let slow = read(&straight(), &along(&straight(), |t| braked(8.0, 2.0, t)), Some(40));
    assert_eq!((slow.category, slow.other_branch), (Deviation::Longitudinal, false));
    assert!((slow.longitudinal_offset + 48.0).abs() < 0.1, "{}", slow.longitudinal_offset);
    assert!(slow.lateral_offset.abs() < 0.01 && slow.heading_change < 0.1);
}

#[test]
fn stopping_in_the_logged_turn_is_no_other_direction() {
    // The log ends at 90 degrees, the candidate in the middle of the turn.
    let stop = read(&turning(), &along(&turning(), |t| braked(8.0, 0.8, t)), Some(60));
    assert_eq!((stop.category, stop.other_branch), (Deviation::Longitudinal, false));
}

#[test]
fn another_lane_is_lateral() {
    let change = read(&straight(), &along(&changing(), |t| 8.0 * t), Some(50));
    assert_eq!((change.category, change.other_branch), (Deviation::Lateral, false));
    assert!((change.lateral_offset + 3.5).abs() < 1e-6);
    // Half a metre is not a change of lanes.
    let little: Vec<Vec2> = straight().iter().map(|p| Vec2::new(p.x, 0.5)).collect();
    assert_eq!(read(&straight(), &along(&little, |t| 8.0 * t), None).category, Deviation::Longitudinal);
}

#[test]
fn another_branch_is_directional_both_ways() {
    let turn = read(&straight(), &along(&turning(), |t| 8.0 * t), Some(60));
    assert_eq!((turn.category, turn.other_branch), (Deviation::Directional, true));
    assert!((turn.heading_change - 90.0).abs() < 1.0, "{}", turn.heading_change);
    let on = read(&turning(), &along(&straight(), |t| 8.0 * t), Some(60));
    assert_eq!((on.category, on.other_branch), (Deviation::Directional, true));
}

#[test]
fn of_several_cues_the_one_at_the_conflict_counts() {
    // Brakes on the logged lane, then turns: an agent that runs into it while it brakes meets another speed.
    let late = |t: f64| if t < 3.0 { 4.0 * t } else { 12.0 + 9.0 * (t - 3.0) };
    let mixed = |conflict| read(&straight(), &along(&turning(), late), conflict).category;
    assert_eq!(mixed(Some(25)), Deviation::Longitudinal);
    assert_eq!(mixed(Some(70)), Deviation::Directional);
    assert_eq!(mixed(None), Deviation::Directional);
    // The same with a change of lanes.
    let changed = |conflict| read(&straight(), &along(&changing(), |t| 4.0 * t), conflict).category;
    assert_eq!(changed(Some(15)), Deviation::Longitudinal);
    assert_eq!(changed(Some(75)), Deviation::Lateral);
}

#[test]
fn who_is_met_only_beside_the_logged_way_is_met_by_the_shift() {
    // 0.9 m to the left and slower; a box alongside at 2.6 m is touched from there, but not from the logged
    // path.
    let aside: Vec<Vec2> = straight().iter().map(|p| Vec2::new(p.x, (0.03 * p.x).min(1.2))).collect();
    let track = along(&aside, |t| 6.0 * t);
    let scenario = fork();
    let log = along(&straight(), |t| 8.0 * t);
    let (way, av) = (Polyline::new(&straight()).unwrap(), &scenario.start.agents[0]);
    let met = |y: f64| {
        let touched = Some(OrientedBox::new(Vec2::new(track[50].x, y), 0.0, 4.6, 1.9));
        let conflict = Some(Conflict { step: 50, touched });
        classify(&scenario.start.road(), &way, &log, &track, av, conflict).category
    };
    assert!((track[50].y - 0.9).abs() < 0.01, "{}", track[50].y);
    assert_eq!(met(2.6), Deviation::Lateral);
    assert_eq!(met(1.5), Deviation::Longitudinal);
}

#[test]
fn a_lane_change_that_is_met_long_before_the_turn_is_lateral() {
    // To the adjacent lane within 20 m, and off to the left after 80 m.
    let mut points = changing();
    points.retain(|p| p.x < 60.0);
    points.extend(line((61.0, -3.5), (80.0, -3.5)));
    points.extend(arc((80.0, -3.5), 0.0, 12.0, FRAC_PI_2).into_iter().skip(1));
    points.extend(line((92.0, 9.5), (92.0, 60.0)));
    let track = along(&points, |t| 13.0 * t);
    assert_eq!(read(&straight(), &track, Some(25)).category, Deviation::Lateral);
    assert_eq!(read(&straight(), &track, Some(72)).category, Deviation::Directional);
}

#[test]
fn backwards_is_no_other_direction() {
    let back: Vec<Vec2> = line((0.0, 0.0), (-100.0, 0.0));
    let reversing = |speed: f64| -> Vec<AgentState> {
        (0..=FUTURE).map(|k| state(-speed * k as f64 * DT, 0.0, 0.0, -speed)).collect()
    };
    let scenario = fork();
    let (way, av) = (Polyline::new(&back).unwrap(), &scenario.start.agents[0]);
    let read = classify(&scenario.start.road(), &way, &reversing(2.0), &reversing(1.0), av, None);
    assert_eq!(read.category, Deviation::Longitudinal);
    assert!(read.heading_change < 1e-6);
}
