//! No agent is moved to a lane, dropped, confused or invented (nuplan-devkit #268 and #421, and behaviour of
//! other simulators).

use reactsim::geometry::{Vec2, wrap};
use reactsim::scene::{
    AgentKind, AgentState, CURRENT, DT, FRAMES, FUTURE, HISTORY, LoggedAgent, MapParts, Scenario,
};

use super::no_contact;
use crate::scenes::{agent, bits, bystander, car, future, idm, lane, later, line, scene, state, straight};

/// Fails if the steps are not those of a vehicle that goes on from where it is.
#[track_caller]
fn continuous(scenario: &Scenario, track: &[AgentState]) {
    let mut v = track[0].speed();
    for (k, w) in track.windows(2).enumerate() {
        let (a, b) = (&w[0], &w[1]);
        let jump =
            (b.position() - later(&AgentState { vx: 0.0, vy: 0.0, ..*a }, 0.0).position()).norm() - v * DT;
        let turned = wrap(b.heading - a.heading).abs();
        assert!(jump.abs() < 0.06 + 0.01 * v, "{}: jumps by {jump:.3} m at step {}", scenario.id, k + 1);
        assert!(turned < 0.3 * v * DT + 0.01, "{}: turns by {turned:.3} at step {}", scenario.id, k + 1);
        v = b.speed();
        assert!(
            (v - a.speed()).abs() < 0.6,
            "{}: {:.2} to {v:.2} m/s at step {}",
            scenario.id,
            a.speed(),
            k + 1
        );
    }
}

#[test]
fn everybody_goes_on_from_where_it_is() {
    for offset in [-1.6, -0.8, 0.0, 1.2, 2.6, 4.5] {
        for angle in [-0.2, 0.0, 0.15] {
            for speed in [2.0, 8.0, 14.0] {
                let own = car("own", 0.0, offset, angle, speed);
                let id = format!("offset {offset}, angle {angle}, {speed} m/s");
                let scenario = scene(&id, vec![bystander(), own], straight());
                let track = future(&scenario, &idm(&scenario), "own");
                continuous(&scenario, &track);
                let ahead = later(&track[0], DT);
                let off = (track[1].position() - ahead.position()).norm();
                assert!(off < 0.03 + 0.01 * speed, "{id}: the first step is {off:.3} m off");
            }
        }
    }
}

#[test]
fn nobody_is_dropped_and_the_parked_stay() {
    let agents = vec![
        car("av", 0.0, 0.0, 0.0, 8.0),
        car("kerb", 20.0, -2.9, 0.0, 0.0),
        car("lot", 30.0, 25.0, 0.8, 0.0),
        car("across", 200.0, 1.5, 1.57, 0.0),
        car("field", -30.0, 60.0, 0.3, 5.0),
        car("close", 20.0, -5.2, 0.0, 0.0),
        agent("bicycle stand", AgentKind::Cyclist, state(15.0, -4.0, 1.5, 0.0)),
    ];
    let scenario = scene("kept", agents, straight());
    let rollout = idm(&scenario);
    assert_eq!(scenario.start.agents.len(), 7);
    for parked in ["kerb", "lot", "across", "close", "bicycle stand"] {
        for s in future(&scenario, &rollout, parked) {
            let now = scenario.start.now(crate::scenes::slot(&scenario, parked));
            assert_eq!((s.x, s.y, s.heading), (now.x, now.y, now.heading), "`{parked}` moves");
        }
    }
    let field = future(&scenario, &rollout, "field");
    assert!(
        (field[FUTURE].position() - field[0].position()).norm() > 20.0,
        "`field` drives on beside all lanes"
    );
    no_contact(&scenario, &rollout);
}

#[test]
fn overlapping_starts_are_kept_and_are_lawful() {
    let agents = vec![bystander(), car("a", 0.0, 0.0, 0.0, 5.0), car("b", 2.0, 0.6, 0.0, 5.0)];
    let scenario = scene("overlap", agents, straight());
    let rollout = idm(&scenario);
    for id in ["a", "b"] {
        let track = future(&scenario, &rollout, id);
        let at = &scenario.start.now(crate::scenes::slot(&scenario, id));
        assert_eq!((track[0].x, track[0].y), (at.x, at.y));
    }
}

/// Returns a straight lane without a limit, and another one far away with a limit.
fn unlimited(other: Option<f64>, other_first: bool) -> MapParts {
    let mut lanes = vec![lane("main", line((-150.0, 0.0), (350.0, 0.0)), None)];
    if let Some(limit) = other {
        let at = if other_first { 0 } else { 1 };
        lanes.insert(at, lane("other", line((-150.0, 60.0), (350.0, 60.0)), Some(limit)));
    }
    MapParts { lanes, ..MapParts::default() }
}

#[test]
fn a_lane_without_a_limit_has_no_other_lanes_limit() {
    let agents = || vec![bystander(), car("fast", 0.0, 60.0, 0.0, 20.0), car("own", 0.0, 0.0, 0.0, 8.0)];
    let alone = scene("limits", agents(), unlimited(None, false));
    let expected = future(&alone, &idm(&alone), "own");
    assert!(expected[FUTURE].speed() < 14.0, "{:.1} m/s where no limit is known", expected[FUTURE].speed());
    for (limit, first) in [(3.0, true), (3.0, false), (25.0, true), (25.0, false)] {
        let scenario = scene("limits", agents(), unlimited(Some(limit), first));
        assert_eq!(future(&scenario, &idm(&scenario), "own"), expected, "a limit of {limit} elsewhere");
    }
}

#[test]
fn limits_end_with_their_lanes() {
    let mut lanes = vec![
        lane("slow", line((-50.0, 0.0), (40.0, 0.0)), Some(6.0)),
        lane("open", line((40.0, 0.0), (300.0, 0.0)), None),
    ];
    crate::scenes::join(&mut lanes, "slow", "open");
    let map = MapParts { lanes, ..MapParts::default() };
    let scenario = scene("limit ends", vec![bystander(), car("own", 10.0, 0.0, 0.0, 6.0)], map);
    let track = future(&scenario, &idm(&scenario), "own");
    let before = track.iter().filter(|s| s.x < 36.0).map(AgentState::speed).fold(0.0, f64::max);
    assert!(before < 7.0, "{before:.1} m/s where 6 are allowed");
    assert!(track[FUTURE].speed() > 8.0, "{:.1} m/s after the limit", track[FUTURE].speed());
}

#[test]
fn a_box_of_size_zero_ends_nothing() {
    for (length, width) in [(0.0, 0.0), (0.0, 2.0), (4.0, 0.0)] {
        let mut nothing = car("nothing", 15.0, 0.0, 0.0, 0.0);
        (nothing.agent.length, nothing.agent.width) = (length, width);
        let agents = |with: bool| {
            let all = vec![bystander(), car("own", 0.0, 0.0, 0.0, 10.0)];
            all.into_iter().chain(with.then(|| nothing.clone())).collect()
        };
        let (with, without) =
            (scene("zero", agents(true), straight()), scene("zero", agents(false), straight()));
        assert_eq!(with.repairs.values().sum::<u32>(), 1, "counted, not passed over in silence");
        assert_eq!(bits(&idm(&with).tracks), bits(&idm(&without).tracks), "it stands for an absent agent");
    }
    // A tiny agent is not an absent one.
    let mut tiny = car("tiny", 15.0, 0.0, 0.0, 5.0);
    (tiny.agent.length, tiny.agent.width) = (1e-9, 1e-9);
    let scenario = scene("tiny", vec![bystander(), tiny, car("own", 0.0, 0.0, 0.0, 5.0)], straight());
    future(&scenario, &idm(&scenario), "tiny");
}

#[test]
fn whole_turns_of_headings_change_nothing() {
    let agents = |turns: [f64; 4]| {
        let at = |k: usize, h: f64| h + turns[k] * std::f64::consts::TAU;
        vec![
            car("av", 60.0, 0.0, at(0, 0.0), 6.0),
            car("own", 0.0, 0.3, at(1, 0.05), 12.0),
            car("oncoming", 120.0, 3.6, at(2, std::f64::consts::PI), 10.0),
            agent("rider", AgentKind::Cyclist, state(-15.0, -0.5, at(3, 0.0), 4.0)),
        ]
    };
    let mut map = straight();
    map.lanes.push(lane("back", line((350.0, 3.6), (-150.0, 3.6)), Some(15.0)));
    let plain = scene("turns", agents([0.0; 4]), map.clone());
    let plain = idm(&plain);
    for turns in [[1.0, -1.0, -1.0, 2.0], [-2.0, 1.0, 1.0, -1.0], [0.0, 3.0, -2.0, 0.0]] {
        let scenario = scene("turns", agents(turns), map.clone());
        let turned = idm(&scenario);
        for (a, b) in plain.tracks.iter().flatten().zip(turned.tracks.iter().flatten()) {
            let (a, b) = (a.unwrap(), b.unwrap());
            let off = (a.position() - b.position()).norm();
            assert!(off < 1e-6 && wrap(a.heading - b.heading).abs() < 1e-6, "{off} m off with {turns:?}");
        }
    }
}

#[test]
fn names_are_names_only() {
    let scene_of = |ids: [&str; 4]| {
        let agents = vec![
            car(ids[0], 45.0, 0.0, 0.0, 2.0),
            car(ids[1], 0.0, 0.0, 0.0, 12.0),
            car(ids[2], -18.0, 0.0, 0.0, 12.0),
            car(ids[3], -36.0, 0.0, 0.0, 12.0),
        ];
        scene("names", agents, straight())
    };
    let plain = scene_of(["w", "x", "y", "z"]);
    let expected = idm(&plain);
    no_contact(&plain, &expected);
    for ids in [["av", "a1", "a12", "a123"], ["a123", "a12", "a1", "a"], [" ", "  ", "   ", "0"]] {
        let scenario = scene_of(ids);
        assert_eq!(bits(&idm(&scenario).tracks), bits(&expected.tracks), "{ids:?}");
    }
}

/// Returns a car that stands in the lane in some frames only.
fn ghost(there: impl Fn(usize) -> bool) -> LoggedAgent {
    let mut ghost = car("ghost", 25.0, 0.0, 0.7, 0.0);
    for (f, state) in ghost.track.iter_mut().enumerate() {
        *state = state.filter(|_| there(f));
    }
    ghost
}

#[test]
fn who_is_absent_is_in_nobodys_way() {
    let agents = |ghost: Option<LoggedAgent>| {
        vec![bystander(), car("own", 0.0, 0.0, 0.0, 10.0)].into_iter().chain(ghost).collect()
    };
    let without = scene("ghost", agents(None), straight());
    let expected = bits(&idm(&without).tracks);
    let before = scene("ghost", agents(Some(ghost(|f| f < CURRENT))), straight());
    assert_eq!(bits(&idm(&before).tracks), expected, "gone before the current frame");
    let after = scene("ghost", agents(Some(ghost(|f| f >= HISTORY))), straight());
    assert_eq!(bits(&idm(&after).tracks), expected, "comes after the current frame");
    // An agent that is present now stays, whatever its log does afterwards.
    let now = scene("ghost", agents(Some(ghost(|f| f == CURRENT))), straight());
    let rollout = idm(&now);
    no_contact(&now, &rollout);
    assert!(future(&now, &rollout, "own")[FUTURE].speed() < 0.5);
    assert_eq!(rollout.tracks[2].iter().flatten().count(), FRAMES - CURRENT);
}

#[test]
fn a_scene_far_from_the_origin_is_the_same_scene() {
    let shifted = |by: Vec2| {
        let mut map = straight();
        map.lanes[0].points.iter_mut().for_each(|p| *p += by);
        let mut agents = vec![car("av", 40.0, 0.0, 0.0, 3.0), car("own", 0.0, 0.5, 0.0, 12.0)];
        for state in agents.iter_mut().flat_map(|a| a.track.iter_mut().flatten()) {
            (state.x, state.y) = (state.x + by.x, state.y + by.y);
        }
        let mut parts = crate::scenes::parts("far", agents, map);
        parts.origin = None;
        Scenario::assemble(parts).unwrap()
    };
    let (near, far) = (shifted(Vec2::zeros()), shifted(Vec2::new(48_321.0, -71_007.0)));
    for (a, b) in idm(&near).tracks.iter().flatten().zip(idm(&far).tracks.iter().flatten()) {
        let off = (a.unwrap().position() - b.unwrap().position()).norm();
        assert!(off < 1e-6, "{off} m off");
    }
}
