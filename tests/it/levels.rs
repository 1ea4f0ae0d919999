//! Levels: a bridge with traffic above the road of the AV.

#![allow(clippy::unwrap_used, reason = "tests stop at what they did not expect")]

use std::f64::consts::FRAC_PI_2;

use reactsim::formats;
use reactsim::geometry::Vec2;
use reactsim::rollout::Settings;
use reactsim::scene::{
    CURRENT, FRAMES, LoggedAgent, MapHeights, MapParts, RoadEdge, RoadEdgeKind, Scenario, ScenarioParts,
};

use crate::scenes::{accelerations, car, coasting, future, lane, line, parts, roll_with, scores};
use crate::small_scenarios::write;

/// Returns an agent with the same height at all frames, metres.
fn at_height(agent: LoggedAgent, height: f64) -> LoggedAgent {
    LoggedAgent { heights: vec![Some(height); FRAMES], ..agent }
}

/// Returns the AV on a road along the x axis, and others on a bridge across it that is `above` metres higher.
/// They pass over the AV, and one waits above its path. Everything is `base` metres up; all heights are known
/// or none.
fn overpass(above: f64, base: f64, known: bool) -> ScenarioParts {
    let edge = |from, to| RoadEdge { kind: RoadEdgeKind::Boundary, points: line(from, to) };
    let road_edges = vec![
        edge((-150.0, -4.0), (150.0, -4.0)),
        edge((150.0, 4.0), (-150.0, 4.0)),
        edge((24.0, -150.0), (24.0, 150.0)),
        edge((16.0, 150.0), (16.0, -150.0)),
    ];
    let lanes = vec![
        lane("below", line((-150.0, 0.0), (150.0, 0.0)), Some(13.0)),
        lane("above", line((20.0, -150.0), (20.0, 150.0)), Some(13.0)),
    ];
    let level = |points: &[Vec2], height: f64| vec![height; points.len()];
    let heights = MapHeights {
        lanes: vec![level(&lanes[0].points, base), level(&lanes[1].points, base + above)],
        road_edges: road_edges
            .iter()
            .enumerate()
            .map(|(i, e)| level(&e.points, if i < 2 { base } else { base + above }))
            .collect(),
        ..MapHeights::default()
    };
    let agents = vec![
        at_height(car("av", 0.0, 0.0, 0.0, 10.0), base),
        at_height(car("behind", -30.0, 0.0, 0.0, 10.0), base + 0.2),
        at_height(car("over", 20.0, -20.0, FRAC_PI_2, 10.0), base + above),
        at_height(car("waits", 17.2, 0.0, FRAC_PI_2, 0.0), base + above - 0.3),
    ];
    let mut parts = parts("overpass", agents, MapParts { lanes, road_edges, heights, ..MapParts::default() });
    if !known {
        parts.map.heights = MapHeights::default();
        parts.agents.iter_mut().for_each(|a| a.heights.clear());
    }
    parts
}

fn assembled(above: f64, base: f64, known: bool) -> Scenario {
    Scenario::assemble(overpass(above, base, known)).unwrap()
}

/// Returns the values of the metrics with the logged AV, by id.
fn values(scenario: &Scenario, model: &str) -> Vec<(&'static str, Option<f64>)> {
    let rollout = roll_with(model, scenario, coasting(scenario), &Settings::default(), 0);
    let scores = scores(scenario, &rollout);
    scores.values.iter().map(|(spec, score)| (spec.id, score.and_then(|s| s.value()))).collect()
}

/// Metrics that a meeting of two agents or the leaving of the road changes.
const JUDGED: [&str; 5] = ["aav-collision", "aav-overlap", "aav-ttc", "aa-collision", "offroad"];

#[test]
fn traffic_on_a_bridge_meets_nobody_below() {
    for (scenario, counted) in [
        (assembled(7.0, 0.0, true), false),
        (assembled(7.0, 1830.0, true), false),
        (assembled(7.0, 0.0, false), true),
        (assembled(0.0, 0.0, true), true),
    ] {
        let values = values(&scenario, "log-replay");
        let sum: f64 = values.iter().filter(|v| JUDGED.contains(&v.0)).filter_map(|v| v.1).sum();
        assert_eq!(sum > 0.0, counted, "{values:?}");
    }
}

#[test]
fn heights_that_grow_equally_change_nothing() {
    for above in [0.0, 7.0] {
        let (low, high) = (assembled(above, 0.0, true), assembled(above, 1024.0, true));
        for model in ["log-replay", "idm"] {
            assert_eq!(values(&low, model), values(&high, model), "{model}");
        }
    }
}

#[test]
fn idm_does_not_brake_for_a_bridge() {
    let hardest = |scenario: &Scenario, id: &str| {
        let rollout = roll_with("idm", scenario, coasting(scenario), &Settings::default(), 0);
        accelerations(&future(scenario, &rollout, id)).into_iter().fold(0.0, f64::min)
    };
    let (bridge, junction) = (assembled(7.0, 0.0, true), assembled(7.0, 0.0, false));
    assert!(hardest(&bridge, "behind") > -0.5, "{}", hardest(&bridge, "behind"));
    assert!(hardest(&junction, "behind") < -1.0, "{}", hardest(&junction, "behind"));
}

/// Returns vehicles that come up to a standing AV on a road that rises by `slope` metres per metre, with a
/// bridge across it far behind them.
fn hill(slope: f64) -> Scenario {
    let rises = |x: f64| slope * x;
    let along = |y: f64| line((-400.0, y), (400.0, y));
    let edge = |points| RoadEdge { kind: RoadEdgeKind::Boundary, points };
    let road_edges = vec![
        edge(along(-4.0)),
        edge(along(4.0).into_iter().rev().collect()),
        edge(line((-346.0, -100.0), (-346.0, 100.0))),
        edge(line((-354.0, 100.0), (-354.0, -100.0))),
    ];
    let lanes = vec![
        lane("hill", along(0.0), Some(14.0)),
        lane("bridge", line((-350.0, -100.0), (-350.0, 100.0)), Some(14.0)),
    ];
    let heights = |points: &[Vec2]| points.iter().map(|p| rises(p.x)).collect::<Vec<f64>>();
    let on_bridge = |points: &[Vec2]| vec![rises(-350.0) + 8.0; points.len()];
    let heights = MapHeights {
        lanes: vec![heights(&lanes[0].points), on_bridge(&lanes[1].points)],
        road_edges: (0..4)
            .map(|i| if i < 2 { heights(&road_edges[i].points) } else { on_bridge(&road_edges[i].points) })
            .collect(),
        ..MapHeights::default()
    };
    let mut agents = vec![
        car("av", 60.0, 0.0, 0.0, 0.0),
        car("behind", -20.0, 0.0, 0.0, 13.0),
        car("last", -45.0, 0.0, 0.0, 13.0),
    ];
    for agent in &mut agents {
        agent.heights = agent.track.iter().map(|state| Some(rises(state.unwrap().x))).collect();
    }
    Scenario::assemble(parts("hill", agents, MapParts { lanes, road_edges, heights, ..MapParts::default() }))
        .unwrap()
}

#[test]
fn a_hill_is_driven_as_flat_ground() {
    let flat = hill(0.0);
    for slope in [-0.25, 0.05, 0.2, 0.25] {
        let hill = hill(slope);
        assert_eq!((hill.levels(), hill.repairs.len()), (2, 0));
        for model in ["log-replay", "idm", "qp-regression", "ntp-guarded", "ntp-reactive"] {
            assert_eq!(values(&hill, model), values(&flat, model), "{model} at a slope of {slope}");
        }
    }
}

#[test]
fn heights_that_contradict_one_another_hide_no_contact() {
    // The agent behind runs into the AV in the log.
    let traffic = |change: &dyn Fn(&mut ScenarioParts)| {
        let mut parts = overpass(0.0, 30.0, true);
        parts.agents.truncate(2);
        parts.agents[0] = at_height(car("av", 0.0, 0.0, 0.0, 2.0), 30.0);
        change(&mut parts);
        Scenario::assemble(parts).unwrap()
    };
    let right = traffic(&|_| ());
    let expected = values(&right, "log-replay");
    assert!(expected.iter().any(|v| v.0 == "aav-collision" && v.1 > Some(0.0)), "{expected:?}");
    type Change = Box<dyn Fn(&mut ScenarioParts)>;
    let with_error = |agent: usize, frames: std::ops::Range<usize>, error: f64| -> Change {
        Box::new(move |parts| {
            parts.agents[agent].heights[frames.clone()].iter_mut().flatten().for_each(|z| *z += error);
        })
    };
    let with_spike = |points: std::ops::Range<usize>, size: f64| -> Change {
        Box::new(move |parts| parts.map.heights.lanes[0][points.clone()].iter_mut().for_each(|z| *z += size))
    };
    let changes = [
        with_error(0, 0..FRAMES, -30.0),
        with_error(1, 0..FRAMES, -30.0),
        with_error(1, CURRENT..CURRENT + 1, 3.4),
        with_error(0, CURRENT - 3..CURRENT + 1, -5.0),
        with_spike(10..11, 4.0),
        with_spike(8..14, -6.0),
        Box::new(|parts| parts.agents.iter_mut().for_each(|a| a.heights.fill(Some(0.0)))),
    ];
    for (i, change) in changes.iter().enumerate() {
        let scenario = traffic(change);
        assert_eq!(scenario.notes().len(), right.notes().len() + 1, "{i}: {:?}", scenario.notes());
        for model in ["log-replay", "idm"] {
            assert_eq!(values(&scenario, model), values(&right, model), "{model}, change {i}");
        }
    }
}

#[test]
fn heights_survive_native_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("levels.parquet");
    let named = |i: usize| {
        // The file gets its columns of heights in the second row group.
        let mut scenario = assembled(if i == 9 { 7.0 } else { 0.0 }, 312.25, true);
        scenario.id = format!("{i}");
        scenario
    };
    let scenarios: Vec<Scenario> = (0..11).map(named).collect();
    write(&path, &scenarios);
    let back: Vec<Scenario> = formats::open(&path).unwrap().map(Result::unwrap).collect();
    for (a, b) in scenarios.iter().zip(&back) {
        assert_eq!(a.digest(), b.digest());
        assert_eq!(a.start.map, b.start.map);
        assert_eq!((&a.start.heights, &a.log_future), (&b.start.heights, &b.log_future));
    }
    assert_eq!(back.iter().map(Scenario::levels).collect::<Vec<_>>(), [1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 1]);
    assert_eq!(back[9].start.recorded_height(0, CURRENT), 312.25);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left of the first file");
}
