//! Hand arithmetic through the library's public interface, negative controls, and nearly empty scenes.

use reactsim_geometry::{Polygon, Polyline, Vec2};
use reactsim_metrics::{Case, DirTracking, LoggedTrack, METRICS, Object, Options, Score, metric, score_case};
use reactsim_scene::{
    AgentState, CURRENT, DT, FRAMES, Frame, HISTORY, Lane, LaneArea, LaneClass, LaneKind, LoggedAgent,
    MapIndex, Road, RoadMap,
};

use super::scenes::{Scene, car};

/// Returns a track along the x axis at `speed` with `heading`, at `x` now.
fn straight(x: f64, y: f64, speed: f64, heading: f64) -> Vec<Frame> {
    let state = |f: usize| AgentState {
        x: x + speed * DT * (f as f64 - CURRENT as f64),
        y,
        heading,
        vx: speed,
        vy: 0.0,
    };
    (0..FRAMES).map(|f| Some(state(f))).collect()
}

fn road() -> RoadMap {
    let ring =
        vec![Vec2::new(-500.0, -4.0), Vec2::new(500.0, -4.0), Vec2::new(500.0, 4.0), Vec2::new(-500.0, 4.0)];
    RoadMap {
        lanes: vec![Lane {
            id: "east".into(),
            kind: LaneKind::Lane,
            class: LaneClass::Undefined,
            speed_limit: None,
            baseline: Polyline::new(&[Vec2::new(-500.0, 0.0), Vec2::new(500.0, 0.0)]).unwrap(),
            area: LaneArea::Polygon(ring.clone()),
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: Vec::new(),
            right: Vec::new(),
        }],
        drivable_area: Some(vec![Polygon { exterior: ring, holes: Vec::new() }]),
        ..RoadMap::default()
    }
}

fn scene(map: RoadMap, agents: Vec<LoggedAgent>) -> Scene {
    let log = agents.iter().map(|a| a.track.clone()).collect();
    Scene::new(map, agents, log, 0)
}

/// Returns a scene with a rear-end collision, a wrong-way driver that leaves the road, and a crawling pair
/// that overlaps.
fn accident() -> Scene {
    let mut stray = straight(60.0, 3.0, -6.0, std::f64::consts::PI);
    for (k, state) in stray.iter_mut().skip(HISTORY + 40).enumerate() {
        if let Some(state) = state {
            state.y += 2.0 + k as f64 * 0.01;
        }
    }
    let mut hasty = straight(-40.0, 0.0, 10.0, 0.0);
    if let Some(state) = &mut hasty[50] {
        (state.vx, state.heading) = (14.0, 1.0);
    }
    let agents = vec![
        car("av", straight(0.0, 0.0, 2.0, 0.0)),
        car("hasty", hasty),
        car("stray", stray),
        car("a", straight(-200.0, -2.0, 1.5, 0.0)),
        car("b", straight(-198.0, -2.0, 1.5, 0.0)),
    ];
    scene(road(), agents)
}

#[test]
fn one_accident_is_counted_in_every_metric() {
    let scene = accident();
    let scores = score_case(&scene.case(Options::default()));
    // 36 m of gap at 8 m/s: the boxes overlap for the first time at step 46.
    let hit = scores.events.iter().find(|e| e.metric == "aav-collision").unwrap();
    assert_eq!(
        (hit.step, hit.agent.as_str(), hit.reason, hit.counted),
        (46, "hasty", Some("front_bumper"), true)
    );
    assert_eq!(scores.value("aav-collision"), Some(1.0));
    // 3.2 m at step 41 take 0.4 s; 4.0 m at step 40 would take 0.5 s, which is not below the bound.
    let risk = scores.events.iter().find(|e| e.metric == "aav-ttc").unwrap();
    assert_eq!((risk.step, risk.values[0]), (41, ("ttc", 0.0)));
    // The pair overlaps at all steps, four agents are judged.
    assert_eq!(scores.score("aa-collision"), Some(Score::Rate { hits: 160, valid: 320 }));
    // The stray is beyond y = 4 from step 41 on.
    assert_eq!(scores.score("offroad"), Some(Score::Rate { hits: 40, valid: 320 }));
    let spell = scores.events.iter().find(|e| e.metric == "offroad").unwrap();
    assert_eq!((spell.step, spell.last_step, spell.agent.as_str()), (41, 80, "stray"));
    // Wrong way from step 4 (4 x 0.6 m) to the last step on the lane.
    let wrong = scores.events.iter().find(|e| e.metric == "direction").unwrap();
    assert_eq!((wrong.step, wrong.last_step, wrong.agent.as_str()), (4, 40, "stray"));
    assert_eq!(scores.score("direction"), Some(Score::Rate { hits: 1, valid: 4 }));
    // One wrong velocity: 40 m/s2 up and down again; one wrong heading: 1 rad over about 1.2 m, twice.
    assert_eq!(scores.score("acceleration"), Some(Score::Rate { hits: 2, valid: 320 }));
    assert_eq!(scores.score("curvature"), Some(Score::Rate { hits: 2, valid: 320 }));
    let jerk = scores.events.iter().find(|e| e.metric == "acceleration").unwrap();
    assert_eq!((jerk.step, jerk.last_step), (40, 41));
    assert!((jerk.values[0].1.abs() - 40.0).abs() < 1e-9);
    assert_eq!(scores.value("ade"), Some(0.0));
}

/// The vehicle that drives into the AV replays its log; with another log, it does not.
#[test]
fn collisions_on_the_log_are_told_from_others() {
    let mut scene = accident();
    let distance = |scene: &Scene| {
        let scores = score_case(&scene.case(Options::default()));
        let hit = scores.events.iter().find(|e| e.metric == "aav-collision" && e.counted).unwrap();
        let found = hit.values.iter().find(|v| v.0 == "log_distance").map(|v| v.1);
        (scores.score("log-clinging"), found)
    };
    assert_eq!(distance(&scene), (Some(Score::Rate { hits: 1, valid: 1 }), Some(0.0)));
    // The contact is at step 46, frame 56; an agent one metre away is still on the log.
    for (apart, hits) in [(1.0, 1), (1.5, 0)] {
        let mut logged = straight(-40.0, 0.0, 10.0, 0.0)[56];
        logged.iter_mut().for_each(|s| s.y += apart);
        scene.log[1][56] = logged;
        assert_eq!(distance(&scene), (Some(Score::Rate { hits, valid: 1 }), Some(apart)));
    }
    scene.log[1][56] = None;
    assert_eq!(distance(&scene), (None, None));
}

/// A trailer overlaps its tractor from the first frame on; a car drives into the pair later.
#[test]
fn pairs_that_overlap_at_the_current_frame_can_be_left_out() {
    let pair = |av: bool| {
        let agents = vec![
            car("av", straight(if av { 0.0 } else { 300.0 }, 0.0, 1.0, 0.0)),
            car("tractor", straight(3.0, 0.0, 1.0, 0.0)),
            car("trailer", straight(0.0, if av { 20.0 } else { 0.0 }, 1.0, 0.0)),
            car("late", straight(-10.05, 0.0, 2.0, 0.0)),
        ];
        scene(RoadMap::default(), agents)
    };
    let value = |scene: &Scene, exclude_initial_overlap: bool, aa_include_av: bool, id: &str| {
        let options = Options { exclude_initial_overlap, aa_include_av, ..Options::default() };
        score_case(&scene.case(options)).score(id)
    };
    // The late car touches the trailer after 6.05 s.
    let towed = pair(false);
    assert_eq!(value(&towed, false, false, "aa-collision"), Some(Score::Rate { hits: 180, valid: 240 }));
    assert_eq!(value(&towed, true, false, "aa-collision"), Some(Score::Rate { hits: 40, valid: 240 }));
    // A vehicle that overlaps the AV: contact, risky approach and, if the AV is a partner, collision.
    let joined = pair(true);
    for id in ["aav-overlap", "aav-ttc"] {
        assert_eq!(value(&joined, false, false, id), Some(Score::Count(2)), "{id}");
        assert_eq!(value(&joined, true, false, id), Some(Score::Count(1)), "{id}");
    }
    assert_eq!(value(&joined, false, true, "aa-collision"), Some(Score::Rate { hits: 100, valid: 240 }));
    assert_eq!(value(&joined, true, true, "aa-collision"), Some(Score::Rate { hits: 20, valid: 240 }));
}

/// Touching is not a collision: a gap of 0 between boxes whose distance is computed exactly.
#[test]
fn touching_is_no_collision() {
    for (length, width, x, y) in [(4.0, 2.0, 0.0, -1.75), (4.5, 2.0, 0.0, 0.0), (4.0, 2.0, 10.0, 3.5)] {
        let mut agents =
            vec![car("av", straight(x, y, 0.0, 0.0)), car("a", straight(x - length, y, 0.0, 0.0))];
        for a in &mut agents {
            (a.agent.length, a.agent.width) = (length, width);
        }
        let scores = score_case(&scene(RoadMap::default(), agents).case(Options::default()));
        assert_eq!(scores.value("aav-overlap"), Some(0.0), "{length} x {width} at {x}, {y}");
    }
}

/// Negative control: in the accident, none of the seven metrics is perfect. A metric that never finds a fault
/// fails here.
#[test]
fn nothing_is_perfect_in_an_accident() {
    let scene = accident();
    let scores = score_case(&scene.case(Options::default()));
    for (spec, score) in &scores.values[..7] {
        assert!(score.and_then(Score::value).unwrap() > 0.0, "{}", spec.id);
        assert!(scores.events.iter().any(|e| e.metric == spec.id && e.counted), "{}", spec.id);
    }
}

/// A car drifts to the left edge of the road at y = 4: its left corners leave 1 m before its centre.
#[test]
fn corners_leave_the_road_before_the_centre() {
    let mut drifting = straight(30.0, 0.0, 5.0, 0.0);
    for (step, state) in drifting[CURRENT..].iter_mut().enumerate() {
        state.as_mut().unwrap().y = 0.0501 * step as f64;
    }
    // A car that stands with a corner off the road at the current frame is not judged there.
    let parked = straight(60.0, 3.5, 0.0, 0.0);
    let agents = vec![car("av", straight(0.0, 0.0, 5.0, 0.0)), car("a", drifting), car("b", parked)];
    let scene = scene(road(), agents);
    let off_road = |offroad_corners: bool| {
        score_case(&scene.case(Options { offroad_corners, ..Options::default() })).score("offroad")
    };
    assert_eq!(off_road(false), Some(Score::Rate { hits: 1, valid: 160 }));
    assert_eq!(off_road(true), Some(Score::Rate { hits: 21, valid: 80 }));
}

#[test]
fn ids_are_unique_and_in_the_papers_order() {
    let ids: Vec<&str> = METRICS.iter().map(|m| m.spec().id).collect();
    let paper =
        ["aav-collision", "aav-ttc", "aa-collision", "offroad", "direction", "acceleration", "curvature"];
    assert_eq!(ids[..7], paper);
    let mut sorted = ids.clone();
    sorted.sort_unstable();
    sorted.dedup();
    assert_eq!(sorted.len(), ids.len());
    assert!(ids.iter().all(|id| metric(id).is_some_and(|m| m.spec().id == *id)));
}

#[test]
fn scenes_with_next_to_nothing() {
    let alone = scene(road(), vec![car("av", straight(0.0, 0.0, 5.0, 0.0))]);
    let empty = scene(RoadMap::default(), Vec::new());
    for scene in [alone, empty] {
        let scores = score_case(&scene.case(Options::default()));
        for (spec, score) in &scores.values {
            let expected = matches!(spec.id, "aav-collision" | "aav-ttc" | "aav-overlap").then_some(0.0);
            if spec.id != "kinematic-likelihood" {
                assert_eq!(score.and_then(Score::value), expected, "{}", spec.id);
            }
        }
        assert!(scores.events.is_empty());
    }
    let bare = scene(
        RoadMap::default(),
        vec![car("av", straight(0.0, 0.0, 5.0, 0.0)), car("a", straight(30.0, 0.0, 5.0, 0.0))],
    );
    let scores = score_case(&bare.case(Options::default()));
    assert_eq!((scores.value("offroad"), scores.value("direction")), (None, None));
    assert_eq!(scores.score("acceleration"), Some(Score::Rate { hits: 0, valid: 80 }));
}

#[test]
fn vanished_agents_leave_the_denominators() {
    let mut gone = straight(30.0, 0.0, 5.0, 0.0);
    for state in &mut gone[HISTORY + 20..] {
        *state = None;
    }
    let scene = scene(road(), vec![car("av", straight(0.0, 0.0, 5.0, 0.0)), car("a", gone)]);
    let scores = score_case(&scene.case(Options::default()));
    assert_eq!(scores.score("aa-collision"), Some(Score::Rate { hits: 0, valid: 20 }));
    assert_eq!(scores.score("offroad"), Some(Score::Rate { hits: 0, valid: 20 }));
    assert_eq!(scores.score("acceleration"), Some(Score::Rate { hits: 0, valid: 20 }));
    // Not logged to the end, so it cannot be compared with its log.
    assert_eq!(scores.value("progress"), None);
}

#[test]
fn progress_shows_a_simulator_that_freezes() {
    let agents = vec![car("av", straight(0.0, 0.0, 5.0, 0.0)), car("a", straight(30.0, 0.0, 5.0, 0.0))];
    let log: Vec<Vec<Frame>> = agents.iter().map(|a| a.track.clone()).collect();
    let mut frozen = agents;
    let now = frozen[1].track[CURRENT];
    // Drives the first half, then stands.
    for f in HISTORY + 40..FRAMES {
        frozen[1].track[f] = frozen[1].track[HISTORY + 39];
    }
    assert!(now.is_some());
    let scene = Scene::new(road(), frozen, log, 0);
    let value = score_case(&scene.case(Options::default())).value("progress").unwrap();
    assert!((value - 0.5).abs() < 1e-9, "{value}");
}

#[test]
fn the_tracking_of_lanes_is_chosen_by_the_map() {
    let agents = [car("av", straight(0.0, 0.0, 5.0, 0.0))];
    let tracking = |map: &RoadMap| {
        let index = MapIndex::new(map);
        let objects = vec![Object { agent: &agents[0].agent, track: (&agents[0].track).into() }];
        Case::new(Road::new(map, &index), objects, 0, Options::default()).options.dir_tracking
    };
    let polygons = road();
    assert_eq!(tracking(&polygons), DirTracking::Route);
    let mut corridors = road();
    corridors.drivable_area = None;
    corridors.lanes[0].area = LaneArea::Corridor { half_width: 1.75 };
    assert_eq!(tracking(&corridors), DirTracking::Pointwise);
}

#[test]
fn bike_lanes_of_centre_line_maps_are_left_out() {
    let mut map = road();
    map.drivable_area = None;
    map.lanes[0].area = LaneArea::Corridor { half_width: 1.75 };
    map.lanes[0].class = LaneClass::Bike;
    let wrong = car("a", straight(60.0, 0.0, -6.0, std::f64::consts::PI));
    for (class, expected) in [(LaneClass::Bike, None), (LaneClass::SurfaceStreet, Some(1.0))] {
        map.lanes[0].class = class;
        let scene = scene(map.clone(), vec![car("av", straight(0.0, 30.0, 5.0, 0.0)), wrong.clone()]);
        for dir_tracking in [DirTracking::Auto, DirTracking::Route] {
            let options = Options { dir_tracking, ..Options::default() };
            assert_eq!(score_case(&scene.case(options)).value("direction"), expected);
        }
    }
}

#[test]
fn a_parked_object_has_the_likelihood_of_the_specification() {
    let agents = [car("av", straight(0.0, 0.0, 0.0, 0.0))];
    let (map, track) = (RoadMap::default(), &agents[0].track);
    let index = MapIndex::new(&map);
    let mut left = track[HISTORY..].to_vec();
    left[40..].fill(None);
    // An object that leaves after step 40 has 39 and 38 central differences, and no missing ones at the end.
    let cases = [
        (&track[HISTORY..], [79.1 / 81.0, 78.1 / 81.1, 79.1 / 81.1, 78.1 / 81.1]),
        (&left[..], [39.1 / 40.0, 38.1 / 39.1, 39.1 / 40.1, 38.1 / 39.1]),
    ];
    for (rollout, expected) in cases {
        let log =
            LoggedTrack { history: &track[..HISTORY], future: &track[HISTORY..], recorded_history: None };
        let objects = vec![Object { agent: &agents[0].agent, track: track.into() }];
        let case = Case::new(Road::new(&map, &index), objects, 0, Options::default())
            .with_log(vec![log])
            .with_rollouts(vec![vec![rollout]])
            .with_leaving(true);
        let likelihood = score_case(&case).likelihood.unwrap();
        for ((name, value), expected) in likelihood.features.into_iter().zip(expected) {
            assert!((value.unwrap() - expected).abs() < 1e-12, "{name}: {value:?}");
        }
    }
}
