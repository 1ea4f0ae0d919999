//! Worked cases of the metric `red-light` (`docs/metrics.md`). The stop line is at x = 0, where a straight
//! lane and a lane to the left begin; a car of 4 m comes along the x axis with 10 m/s, its centre at -20 m
//! at the current frame.

use reactsim_geometry::{Polyline, Vec2, direction};
use reactsim_scene::{
    Agent, AgentKind, AgentState, CURRENT, FRAMES, FUTURE, Frame, HISTORY, Lane, LaneArea, LaneClass,
    LaneKind, LightState, MapIndex, Road, RoadMap,
};

use super::super::{Case, Event, Object, ObservedLight, Options, Score, score_case};

/// Radius of the lane to the left, metres: 8 m behind the line the straight lane still contains its middle.
const RADIUS: f64 = 25.0;

const APPROACH: usize = 0;
const STRAIGHT: usize = 1;
const LEFT: usize = 2;

fn road() -> RoadMap {
    let lane = |id: &str, points: &[Vec2]| Lane {
        id: id.to_owned(),
        kind: LaneKind::Connector,
        class: LaneClass::SurfaceStreet,
        speed_limit: None,
        baseline: Polyline::new(points).unwrap(),
        area: LaneArea::Corridor { half_width: 1.75 },
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: Vec::new(),
        right: Vec::new(),
    };
    let turn: Vec<Vec2> = (0..=30).map(|i| turned(f64::from(i)).0).collect();
    let lanes = vec![
        lane("approach", &[Vec2::new(-200.0, 0.0), Vec2::new(0.0, 0.0)]),
        lane("straight", &[Vec2::new(0.0, 0.0), Vec2::new(100.0, 0.0)]),
        lane("left", &turn),
    ];
    RoadMap { lanes, ..RoadMap::default() }
}

/// Returns point and heading at an arc length of the lane to the left.
fn turned(s: f64) -> (Vec2, f64) {
    let heading = s / RADIUS;
    (Vec2::new(0.0, RADIUS) + direction(heading - std::f64::consts::FRAC_PI_2) * RADIUS, heading)
}

/// Returns the track of a vehicle that is `s(step)` metres beyond the line, 10 m/s or standing.
fn along(left: bool, s: impl Fn(f64) -> f64) -> Vec<Frame> {
    let state = |f: usize| {
        let s = s(f as f64 - CURRENT as f64);
        let (p, heading) = if left && s > 0.0 { turned(s) } else { (Vec2::new(s, 0.0), 0.0) };
        AgentState { x: p.x, y: p.y, heading, vx: f64::NAN, vy: f64::NAN }
    };
    (0..FRAMES).map(|f| Some(state(f))).collect()
}

fn straight() -> Vec<Frame> {
    along(false, |step| step - 20.0)
}

/// States over all frames: those of the history are unknown.
fn states(of: impl Fn(usize) -> Option<LightState>) -> Vec<Option<LightState>> {
    (0..FRAMES).map(|f| f.checked_sub(CURRENT).filter(|step| *step > 0).and_then(&of)).collect()
}

fn red(_: usize) -> Option<LightState> {
    Some(LightState::Stop)
}

/// Scores vehicles, of which the first is the AV, with lights by lane.
fn scored(
    kinds: &[AgentKind],
    tracks: &[Vec<Frame>],
    lights: &[(usize, Vec<Option<LightState>>)],
) -> (Option<Score>, Vec<Event>) {
    let map = road();
    let index = MapIndex::new(&map);
    let agents: Vec<Agent> = kinds
        .iter()
        .enumerate()
        .map(|(i, kind)| Agent { id: i.to_string(), kind: *kind, length: 4.0, width: 2.0 })
        .collect();
    let objects = agents.iter().zip(tracks).map(|(agent, track)| Object { agent, track: track.into() });
    let lights = lights.iter().map(|(lane, states)| ObservedLight {
        lane: *lane,
        stop_point: Vec2::new(0.0, 0.0),
        history: &states[..HISTORY],
        future: &states[HISTORY..],
    });
    let case = Case::new(Road::new(&map, &index), objects.collect(), 0, Options::default())
        .with_lights(lights.collect());
    let scores = score_case(&case);
    (scores.score("red-light"), scores.events.into_iter().filter(|e| e.metric == "red-light").collect())
}

/// Returns the value for one car, and its events, where the lane straight on has this light.
fn one(track: Vec<Frame>, of: impl Fn(usize) -> Option<LightState>) -> (Option<Score>, Vec<Event>) {
    let parked = along(false, |_| -150.0);
    scored(&[AgentKind::Vehicle; 2], &[parked, track], &[(STRAIGHT, states(of))])
}

#[track_caller]
fn obeys(track: Vec<Frame>, of: impl Fn(usize) -> Option<LightState>) {
    let (score, events) = one(track, of);
    assert_eq!((score, events.len()), (Some(Score::Rate { hits: 0, valid: 1 }), 0), "{events:?}");
}

#[test]
fn front_and_centre_cross_under_red() {
    for state in [LightState::Stop, LightState::ArrowStop] {
        let (score, events) = one(straight(), |_| Some(state));
        assert_eq!(score, Some(Score::Rate { hits: 1, valid: 1 }));
        let [event] = events.as_slice() else { panic!("{events:?}") };
        assert_eq!((event.step, event.last_step, event.agent.as_str()), (18, 20, "1"));
        assert_eq!((event.reason, event.counted), (Some(state.name()), true));
        let value = |name: &str| event.values.iter().find(|v| v.0 == name).unwrap().1;
        assert_eq!((value("lane"), value("x"), value("y")), (STRAIGHT as f64, 0.0, 0.0));
        assert!((value("speed") - 10.0).abs() < 1e-9);
    }
}

#[test]
fn red_decides_while_the_vehicle_crosses() {
    let from = |first: usize, before: LightState, after: LightState| {
        move |step: usize| Some(if step < first { before } else { after })
    };
    obeys(straight(), from(19, LightState::Caution, LightState::Stop));
    obeys(straight(), from(20, LightState::Stop, LightState::Go));
    assert_eq!(one(straight(), from(18, LightState::Go, LightState::Stop)).1.len(), 1);
    assert_eq!(one(straight(), from(21, LightState::Stop, LightState::Go)).1.len(), 1);
    for state in [
        LightState::FlashingStop,
        LightState::FlashingCaution,
        LightState::Caution,
        LightState::ArrowCaution,
        LightState::Go,
        LightState::ArrowGo,
    ] {
        obeys(straight(), |_| Some(state));
    }
}

#[test]
fn unknown_lights_are_not_judged() {
    for unknown in [None, Some(LightState::Unknown)] {
        obeys(straight(), |step| if step == 19 { unknown } else { red(step) });
        assert_eq!(one(straight(), |_| unknown), (None, Vec::new()));
    }
    // Only the past is known.
    let past: Vec<_> = (0..FRAMES).map(|f| red(f).filter(|_| f < HISTORY)).collect();
    let tracks = [along(false, |_| -150.0), straight()];
    assert_eq!(scored(&[AgentKind::Vehicle; 2], &tracks, &[(STRAIGHT, past)]).0, None);
    assert_eq!(scored(&[AgentKind::Vehicle; 2], &tracks, &[]).0, None);
}

#[test]
fn stopping_over_the_line_is_no_crossing() {
    obeys(along(false, |step| (step - 20.0).min(-1.0)), red);
    // The front trembles at the line.
    obeys(along(false, |step| -2.05 + 0.1 * (step % 2.0)), red);
    // The front is over the line under red, and the car goes on under green.
    let waits = along(false, |step| if step < 40.0 { (step - 20.0).min(-1.0) } else { step - 41.0 });
    obeys(waits, |step| if step < 40 { red(step) } else { Some(LightState::Go) });
    // Too late to see the lane: the centre is 5 m behind the line at the end.
    obeys(along(false, |step| step - FUTURE as f64 + 5.0), red);
}

#[test]
fn vehicles_past_the_line_at_the_current_frame_do_not_count() {
    obeys(along(false, |step| step - 1.0), red);
    // One that comes into view between front and centre is not judged either.
    let mut late = straight();
    late[CURRENT + 1..CURRENT + 19].fill(None);
    obeys(late, red);
    let mut seen = straight();
    seen[CURRENT + 1..CURRENT + 17].fill(None);
    assert_eq!(one(seen, red).1.len(), 1);
}

#[test]
fn each_lane_has_its_own_light() {
    let go = states(|_| Some(LightState::Go));
    let lights = |straight: Vec<_>, left: Vec<_>| [(STRAIGHT, straight), (LEFT, left)];
    let turn = || along(true, |step| step - 20.0);
    for (track, lights, lane) in [
        (straight(), lights(go.clone(), states(red)), None),
        (straight(), lights(states(red), go.clone()), Some(STRAIGHT)),
        (turn(), lights(states(red), go.clone()), None),
        (turn(), lights(go.clone(), states(red)), Some(LEFT)),
        (turn(), lights(states(red), states(red)), Some(LEFT)),
    ] {
        let tracks = [along(false, |_| -150.0), track];
        let (score, events) = scored(&[AgentKind::Vehicle; 2], &tracks, &lights);
        assert_eq!(score, Some(Score::Rate { hits: u64::from(lane.is_some()), valid: 1 }));
        let lanes: Vec<f64> = events.iter().map(|e| e.values[0].1).collect();
        assert_eq!(lanes, lane.map(|lane| lane as f64).into_iter().collect::<Vec<_>>());
    }
    // The lane before the line may have the light as well.
    let tracks = [along(false, |_| -150.0), turn()];
    let approach = [(APPROACH, states(red))];
    assert_eq!(
        scored(&[AgentKind::Vehicle; 2], &tracks, &approach).1[0].values[0],
        ("lane", APPROACH as f64)
    );
    // A vehicle on another road, beside the line or across it.
    let beside = |dy: f64, heading: f64| -> Vec<Frame> {
        let place = |frame: Frame| {
            frame.map(|s| {
                let p = direction(heading) * s.x;
                AgentState { x: p.x, y: p.y + dy, heading, ..s }
            })
        };
        straight().into_iter().map(place).collect()
    };
    obeys(beside(3.5, 0.0), red);
    obeys(beside(0.0, 1.0), red);
}

#[test]
fn all_vehicles_are_in_the_denominator() {
    use AgentKind::{Cyclist, Other, Pedestrian, Vehicle};
    let kinds = [Vehicle, Vehicle, Cyclist, Pedestrian, Other, Vehicle];
    let tracks: Vec<_> = kinds.iter().map(|_| straight()).take(5).chain([along(false, |_| -100.0)]).collect();
    let (score, events) = scored(&kinds, &tracks, &[(STRAIGHT, states(red))]);
    assert_eq!(score, Some(Score::Rate { hits: 1, valid: 2 }));
    assert_eq!(events.iter().map(|e| e.agent.as_str()).collect::<Vec<_>>(), ["1"]);
    // The AV has no company.
    assert_eq!(scored(&[Vehicle], &tracks[..1], &[(STRAIGHT, states(red))]).0, None);
}
