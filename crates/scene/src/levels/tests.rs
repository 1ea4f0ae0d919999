//! Tests of levels on roads made by hand: one along the x axis at height 0, one across it above.

use super::*;
use crate::{
    Agent, AgentState, CURRENT, FRAMES, LaneClass, LaneKind, LaneParts, LoggedAgent, MapParts, RoadEdge,
    RoadEdgeKind, ScenarioParts,
};

fn line(from: Vec2, to: Vec2) -> Vec<Vec2> {
    (0..=40).map(|k| from + (to - from) * (f64::from(k) / 40.0)).collect()
}

fn lane(id: &str, points: Vec<Vec2>) -> LaneParts {
    LaneParts {
        id: id.into(),
        kind: LaneKind::Connector,
        class: LaneClass::Undefined,
        points,
        ..LaneParts::default()
    }
}

pub(in crate::levels) fn car(id: &str, at: Vec2, velocity: Vec2, height: f64) -> LoggedAgent {
    let state = |f: usize| {
        let p = at + velocity * (0.1 * (f as f64 - CURRENT as f64));
        Some(AgentState { x: p.x, y: p.y, heading: 0.0, vx: velocity.x, vy: velocity.y })
    };
    LoggedAgent {
        agent: Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 },
        track: (0..FRAMES).map(state).collect(),
        heights: vec![Some(height); FRAMES],
    }
}

/// Returns a road along the x axis and one along the y axis, `above` metres higher, with edges; the whole
/// scene is at the height `base`.
pub(in crate::levels) fn crossing(above: f64, base: f64) -> ScenarioParts {
    let (west, east) = (Vec2::new(-100.0, 0.0), Vec2::new(100.0, 0.0));
    let (south, north) = (Vec2::new(0.0, -100.0), Vec2::new(0.0, 100.0));
    let aside = Vec2::new(0.0, 5.0);
    let edge = |from: Vec2, to: Vec2| RoadEdge { kind: RoadEdgeKind::Boundary, points: line(from, to) };
    let right = Vec2::new(5.0, 0.0);
    let map = MapParts {
        lanes: vec![lane("below", line(west, east)), lane("above", line(south, north))],
        road_edges: vec![
            edge(west - aside, east - aside),
            edge(east + aside, west + aside),
            edge(south + right, north + right),
            edge(north - right, south - right),
        ],
        heights: MapHeights {
            lanes: vec![vec![base; 41], vec![base + above; 41]],
            road_edges: [base, base, base + above, base + above].map(|z| vec![z; 41]).to_vec(),
            ..MapHeights::default()
        },
        ..MapParts::default()
    };
    let agents = vec![
        car("av", Vec2::new(-40.0, 0.0), Vec2::new(5.0, 0.0), base + 0.3),
        car("other", Vec2::new(0.0, -40.0), Vec2::new(0.0, 5.0), base + above - 0.2),
    ];
    ScenarioParts { id: "crossing".into(), agents, map, ..ScenarioParts::default() }
}

fn assembled(above: f64, base: f64) -> Scenario {
    Scenario::assemble(crossing(above, base)).unwrap()
}

#[test]
fn a_road_above_another_is_a_level() {
    assert_eq!(assembled(7.0, 0.0).levels(), 2);
    assert_eq!(assembled(7.0, 412.3).levels(), 2);
    assert_eq!(assembled(2.5, 0.0).levels(), 1);
    assert_eq!(assembled(0.0, 0.0).levels(), 1);
}

#[test]
fn one_level_is_as_without_heights() {
    let mut without = crossing(0.0, 0.0);
    without.map.heights = MapHeights::default();
    without.agents.iter_mut().for_each(|a| a.heights.clear());
    let without = Scenario::assemble(without).unwrap();
    for (above, base) in [(0.0, 0.0), (1.0, 0.0), (0.0, 200.0)] {
        let scenario = assembled(above, base);
        assert!(!scenario.start.has_levels() && scenario.start.heights.is_empty());
        assert_eq!(scenario.digest(), without.digest());
    }
    assert_ne!(assembled(7.0, 0.0).digest(), without.digest());
}

#[test]
fn queries_find_what_is_on_their_level() {
    let scenario = assembled(7.0, 100.0);
    // The origin is at the AV.
    let centre = Vec2::new(40.0, 0.0);
    let road = scenario.start.road();
    let mut hits = Vec::new();
    let mut lanes = |road: Road<'_>| {
        road.lanes_at(centre, &mut hits);
        let at: Vec<usize> = hits.iter().map(|h| h.lane).collect();
        road.lanes_near(centre, 3.0, &mut hits);
        assert_eq!(at, hits.iter().map(|h| h.lane).collect::<Vec<_>>());
        assert_eq!(at, (0..2).filter(|&l| road.lane_at(centre, l).is_some()).collect::<Vec<_>>());
        at
    };
    assert_eq!(lanes(road), [0, 1]);
    assert_eq!(lanes(road.on_level(centre, 100.5)), [0]);
    assert_eq!(lanes(road.on_level(centre, 106.0)), [1]);
    assert_eq!(lanes(road.on_level(centre, f64::NAN)), [0, 1]);
    // Beside the bridge: nearest to its edge, from outside.
    let beside = centre + Vec2::new(6.0, 0.0);
    assert_eq!(road.drivable(beside, &mut None), Some(false));
    assert_eq!(road.on_level(centre, 100.0).drivable(beside, &mut None), Some(true));
    assert_eq!(road.on_level(centre, 107.0).drivable(beside, &mut None), Some(false));
    assert_eq!(road.on_level(centre, 100.0).distance_off_road(beside, &mut None), Some(0.0));
}

#[test]
fn heights_follow_the_road_under_a_track() {
    // A ramp that rises by 9 m to the road above.
    let mut parts = crossing(9.0, 0.0);
    parts.map.lanes.push(lane("ramp", line(Vec2::new(-100.0, 50.0), Vec2::new(100.0, 50.0))));
    let ramp: Vec<f64> = (0..=40).map(|k| 9.0 * f64::from(k) / 40.0).collect();
    parts.map.heights.lanes.push(ramp);
    let scenario = Scenario::assemble(parts).unwrap();
    let start = &scenario.start;
    let along = |agent: usize, at: &dyn Fn(f64) -> Vec2| {
        let state = |k: usize| {
            let p = at(k as f64 / 80.0);
            Some(AgentState { x: p.x, y: p.y, heading: 0.0, vx: 0.0, vy: 0.0 })
        };
        start.heights_along(agent, &(0..=80).map(state).collect::<Vec<_>>())
    };
    // The AV passes below the bridge; the other agent stays on it.
    let below = along(0, &|t| Vec2::new(80.0 * t, 0.0));
    assert_eq!((below[0], below[80]), (0.3, 0.0));
    assert!(below[1..].iter().all(|h| *h == 0.0));
    let above = along(1, &|t| Vec2::new(40.0, -40.0 + 80.0 * t));
    assert!(above[1..].iter().all(|h| *h == 9.0), "{above:?}");
    let up = along(0, &|t| Vec2::new(-50.0 + 190.0 * t, 50.0));
    assert!(up.windows(2).all(|w| w[1] - w[0] < 0.5) && up[80] == 9.0, "{up:?}");
    // Off the mapped road the last height is kept.
    let off = along(1, &|t| Vec2::new(40.0 + 25.0 * t, 30.0));
    assert_eq!(off[80], 9.0);
    let absent = start.heights_along(0, &[None, None]);
    assert!(absent.iter().all(|h| h.is_nan()));
}

/// Returns a road along the x axis that rises by `slope` metres per metre, and the crossing with its bridge
/// far away.
fn hill(slope: f64) -> ScenarioParts {
    let mut parts = crossing(7.0, 0.0);
    let moved = |points: &mut Vec<Vec2>| points.iter_mut().for_each(|p| p.y += 500.0);
    parts.map.lanes.iter_mut().for_each(|l| moved(&mut l.points));
    parts.map.road_edges.iter_mut().for_each(|e| moved(&mut e.points));
    let points = line(Vec2::new(-200.0, 0.0), Vec2::new(200.0, 0.0));
    parts.map.heights.lanes.push(points.iter().map(|p| slope * p.x).collect());
    parts.map.lanes.push(lane("hill", points));
    let height = |x: f64| slope * x + 0.2;
    parts.agents = vec![car("av", Vec2::zeros(), Vec2::zeros(), height(0.0))];
    for x in [-150.0, -60.0, -25.0, 12.0, 40.0, 90.0] {
        parts.agents.push(car(&x.to_string(), Vec2::new(x, 1.0), Vec2::zeros(), height(x)));
    }
    parts
}

#[test]
fn a_hill_is_one_level() {
    for slope in [-0.25, -0.1, 0.0, 0.05, 0.12, 0.2, 0.25, 0.3] {
        let scenario = Scenario::assemble(hill(slope)).unwrap();
        let (start, road) = (&scenario.start, scenario.start.road());
        assert_eq!((scenario.levels(), scenario.repairs.len()), (2, 0), "slope {slope}");
        let places: Vec<(Vec2, f64)> =
            (0..start.agents.len()).map(|i| (start.now(i).position(), start.height_now(i))).collect();
        for &a in &places {
            assert!(places.iter().all(|&b| !road.is_apart(a, b)), "slope {slope}, {a:?}");
            let ahead = Vec2::new(150.0, 1.0);
            let (level, mut hits) = (road.on_level(a.0, a.1), Vec::new());
            level.lanes_at(ahead, &mut hits);
            assert_eq!(hits.len(), 1, "slope {slope}");
            // Above or below the hill.
            for off in [-6.0, 6.0] {
                let other = Vec2::new(a.0.x + 8.0, 1.0);
                assert!(road.is_apart(a, (other, a.1 + off + 8.0 * slope)), "slope {slope}, {a:?}");
            }
        }
        // The roads of the crossing stay apart at any distance at which agents meet.
        for (x, y) in [(0.0, 0.0), (10.0, 0.0), (0.0, 30.0), (40.0, 20.0)] {
            let (low, high) = (Vec2::new(x, 500.0), Vec2::new(0.0, 500.0 + y));
            let is_apart = road.is_apart((low, 0.1), (high, 7.1)) && road.is_apart((high, 7.1), (low, 0.1));
            assert!(is_apart, "slope {slope}: {low} and {high}");
        }
    }
}

#[test]
fn an_unknown_height_is_that_of_the_road_where_it_has_one_level() {
    let mut parts = crossing(7.0, 0.0);
    parts.agents.iter_mut().for_each(|a| a.heights.clear());
    let scenario = Scenario::assemble(parts).unwrap();
    assert_eq!(scenario.start.height_now(0), 0.0);
    assert_eq!(scenario.start.height_now(1), 7.0);
    let mut parts = crossing(7.0, 0.0);
    parts.agents[0] = car("av", Vec2::new(0.0, 0.0), Vec2::zeros(), f64::NAN);
    let scenario = Scenario::assemble(parts).unwrap();
    assert!(scenario.start.height_now(0).is_nan());
}

#[test]
fn heights_of_another_shape_are_refused() {
    let mut parts = crossing(7.0, 0.0);
    parts.map.heights.lanes[1].pop();
    let message = Scenario::assemble(parts).unwrap_err().to_string();
    assert!(message.contains("map.heights.lanes[1]") && message.contains("40 heights"), "{message}");
    let mut parts = crossing(7.0, 0.0);
    parts.map.heights.road_edges.pop();
    let message = Scenario::assemble(parts).unwrap_err().to_string();
    assert!(message.contains("map.heights.road_edges") && message.contains("3 lists"), "{message}");
    let mut parts = crossing(7.0, 0.0);
    parts.agents[1].heights.pop();
    let message = Scenario::assemble(parts).unwrap_err().to_string();
    assert!(message.contains("agents[1].heights"), "{message}");
}

#[test]
fn repeated_points_of_a_lane_keep_the_heights_of_the_others() {
    let p = |x: f64| Vec2::new(x, 0.0);
    assert_eq!(of_polyline(&[p(0.0), p(0.0), p(1.0), p(2.0)], &[5.0, 6.0, 7.0, 8.0]), [5.0, 7.0, 8.0]);
    assert!(of_polyline(&[p(0.0), p(1.0)], &[]).is_empty());
}

#[test]
fn a_future_height_is_not_known_at_the_current_frame() {
    let scenario = assembled(7.0, 0.0).without_future();
    assert!(scenario.log_future.heights.iter().flatten().all(Option::is_none));
    assert_eq!(scenario.start.heights[1].len(), 11);
}

#[test]
fn heights_that_are_followed_are_those_from_the_start() {
    let scenario = assembled(6.0, 0.0);
    let start = &scenario.start;
    let mut followed = RoadHeights::default();
    let mut tracks: Vec<Vec<Frame>> = start.history.clone();
    for step in 0..30 {
        let (known, all) = (followed.at_end(start, &tracks), RoadHeights::default().at_end(start, &tracks));
        assert_eq!(known.len(), start.agents.len());
        let bits = |heights: &[f64]| heights.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&known), bits(&all), "step {step}");
        let per_agent: Vec<f64> = (0..tracks.len())
            .map(|i| *start.heights_along(i, &tracks[i][start.current()..]).last().unwrap())
            .collect();
        assert_eq!(bits(&known), bits(&per_agent), "step {step}");
        // Each agent is absent once.
        for (i, track) in tracks.iter_mut().enumerate() {
            track.push(scenario.logged_at(i, CURRENT + 1 + step).filter(|_| step != 3 + i));
        }
        // A call may come after several frames.
        if step % 3 == 1 {
            for (i, track) in tracks.iter_mut().enumerate() {
                track.push(scenario.logged_at(i, CURRENT + 2 + step));
            }
        }
    }
}

#[test]
fn heights_of_the_latest_and_of_planned_frames_are_those_along_the_whole_track() {
    let scenario = assembled(6.0, 0.0);
    let start = &scenario.start;
    let logged: Vec<Vec<Frame>> = (0..start.agents.len()).map(|agent| scenario.logged(agent)).collect();
    let whole = |agent: usize, track: &[Frame]| *start.heights_along(agent, track).last().unwrap();
    let mut heights = RoadHeights::default();
    for frame in (CURRENT..CURRENT + 42).step_by(3) {
        let mut tracks: Vec<Vec<Frame>> = logged.iter().map(|track| track[..=frame].to_vec()).collect();
        if let Some(absent) = tracks[1].get_mut(19) {
            *absent = None;
        }
        heights.follow(start, &tracks, frame - 4);
        assert!(heights.kept.iter().all(|kept| kept.len() <= 5), "only the latest frames are kept");
        for (agent, track) in tracks.iter_mut().enumerate() {
            for at in (frame - 4).max(CURRENT)..=frame {
                let (found, wanted) =
                    (heights.at(start, agent, at, track, 0), whole(agent, &track[CURRENT..=at]));
                assert_eq!(found.to_bits(), wanted.to_bits(), "agent {agent} at frame {at}");
            }
            // Two planned frames, at the end of a part of the track.
            track.extend_from_slice(&logged[agent][frame + 1..frame + 3]);
            let found = heights.at(start, agent, frame + 2, &track[frame - 2..], frame - 2);
            let wanted = whole(agent, &track[CURRENT..]);
            assert_eq!(found.to_bits(), wanted.to_bits(), "agent {agent} after frame {frame}");
            assert!(!found.is_nan());
        }
    }
}
