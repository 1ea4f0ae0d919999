//! Certificates: found if a driver could avoid the AV, refused if none could, and correct in what they state.

mod recheck;

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim::curation::{AvoidanceSettings, Certificate, Response, Unavoidable, certify, certify_case};
use reactsim::geometry::{Polygon, Vec2, direction};
use reactsim::metrics::{Case, Options, score_case};
use reactsim::rollout::ScriptedAv;
use reactsim::scene::{
    AgentKind, AgentState, CURRENT, DT, Difficulty, FUTURE, Frame, LoggedAgent, MapParts, Scenario,
};

use self::recheck::recheck;
use crate::scenes::{agent, car, lane, later, line, real, scene, state, straight};

/// Returns the AV's log as a candidate, changed by `change` (step, logged state).
fn candidate(
    scenario: &Scenario,
    mut change: impl FnMut(usize, AgentState) -> AgentState,
) -> Vec<AgentState> {
    let logged = scenario.logged(0);
    (0..=FUTURE).map(|k| logged[CURRENT + k].unwrap()).enumerate().map(|(k, s)| change(k, s)).collect()
}

/// Returns an AV that brakes along the x axis at `rate` after `delay` seconds.
fn braking(scenario: &Scenario, rate: f64, delay: f64) -> Vec<AgentState> {
    let now = scenario.start.now(0);
    let speed = now.speed();
    candidate(scenario, |k, _| {
        let t = k as f64 * DT;
        let braked = (t - delay).clamp(0.0, speed / rate);
        let way = speed * t.min(delay) + speed * braked - 0.5 * rate * braked * braked;
        let v = direction(now.heading) * if t <= delay { speed } else { speed - rate * braked };
        let p = now.position() + direction(now.heading) * way;
        AgentState { x: p.x, y: p.y, vx: v.x, vy: v.y, ..now }
    })
}

fn found(scenario: &Scenario, av: &[AgentState]) -> Certificate {
    let certificate = certify(scenario, av, &AvoidanceSettings::default())
        .unwrap_or_else(|why| panic!("{}: {why}", scenario.id));
    recheck(scenario, av, &certificate);
    certificate
}

fn refused(scenario: &Scenario, av: &[AgentState]) -> Unavoidable {
    match certify(scenario, av, &AvoidanceSettings::default()) {
        Err(why) => why,
        Ok(certificate) => panic!("{}: {:?}", scenario.id, certificate.peak_deceleration()),
    }
}

fn response<'c>(certificate: &'c Certificate, id: &str) -> &'c Response {
    certificate.responses.iter().find(|r| r.agent == id).unwrap_or_else(|| panic!("no response of `{id}`"))
}

#[test]
fn a_follower_brakes_behind_an_av_that_stops() {
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("follower", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    assert_eq!(certificate.responses.len(), 1);
    let own = response(&certificate, "own");
    assert_eq!(own.nudge, 0.0);
    // The AV is 1.2 m/s slower after 0.4 s; the reaction takes another 0.3 s.
    assert_eq!(own.reaction_step, 7);
    assert!((1.5..5.01).contains(&own.peak_deceleration), "{}", own.peak_deceleration);
    assert_eq!(certificate.peak_deceleration(), own.peak_deceleration);
    assert!(own.clearance >= 0.2, "{}", own.clearance);
    assert!(own.track[FUTURE].speed() < 3.0, "{}", own.track[FUTURE].speed());
}

#[test]
fn the_effort_of_a_follower_is_that_of_the_closed_form() {
    // The AV brakes at 3 m/s² from 10 m/s and stops after 3.3 s; the follower is 15.5 m behind it (bumper to
    // bumper).
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("effort", agents, straight());
    let certificate = found(&scenario, &braking(&scenario, 3.0, 0.0));
    let own = response(&certificate, "own");
    let effort = own.effort.unwrap();
    assert_eq!((own.leader.as_deref(), own.nudge), (None, 0.0));
    assert!(effort.required_deceleration <= own.peak_deceleration, "{effort:?} {}", own.peak_deceleration);
    // The follower must stop within 20 + 16.7 - 4.5 - 0.2 m, of which it drives 7 m before it brakes: v²/2a
    // with the jerk (10 m/s³) is 2 to 2.5 m/s².
    assert!((2.0..2.6).contains(&effort.required_deceleration), "{effort:?}");
    // At 6 m/s² it may react later than after the 0.3 s granted to every agent, but before the AV has
    // stopped.
    assert!((0.8..2.5).contains(&effort.time_to_react), "{effort:?}");
    // The deceleration found to be enough is enough, and a clearly lower one is not.
    let bounded = |max_deceleration| {
        let settings = AvoidanceSettings { max_deceleration, max_nudge: 0.0, ..AvoidanceSettings::default() };
        certify(&scenario, &braking(&scenario, 3.0, 0.0), &settings)
    };
    assert!(bounded(effort.required_deceleration + 1e-9).is_ok());
    assert!(bounded(effort.required_deceleration - 0.15).is_err());
    let reacting = |reaction: f64| {
        let settings = AvoidanceSettings {
            reaction,
            max_deceleration: 6.0,
            max_nudge: 0.0,
            ..AvoidanceSettings::default()
        };
        certify(&scenario, &braking(&scenario, 3.0, 0.0), &settings)
    };
    assert!(reacting(effort.time_to_react).is_ok());
    assert!(reacting(effort.time_to_react + 0.2).is_err());
}

#[test]
fn harder_conflicts_have_harder_grades() {
    let grade = |gap: f64, rate: f64| {
        let agents = vec![car("av", 4.5 + gap, 0.0, 0.0, 12.0), car("own", 0.0, 0.0, 0.0, 12.0)];
        let scenario = scene("grade", agents, straight());
        found(&scenario, &braking(&scenario, rate, 0.0)).difficulty().unwrap()
    };
    assert_eq!(grade(60.0, 2.0), Difficulty::Easy);
    assert_eq!(grade(20.0, 2.0), Difficulty::Medium);
    assert_eq!(grade(12.0, 4.0), Difficulty::Hard);
}

#[test]
fn nobody_responds_to_an_av_that_disturbs_nobody() {
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("undisturbed", agents, straight());
    assert_eq!(found(&scenario, &candidate(&scenario, |_, s| s)), Certificate::default());
}

#[test]
fn a_follower_of_the_follower_brakes_likewise() {
    let agents = vec![
        car("av", 20.0, 0.0, 0.0, 10.0),
        car("first", 4.0, 0.0, 0.0, 10.0),
        car("second", -10.0, 0.0, 0.0, 10.0),
        car("third", -24.0, 0.0, 0.0, 10.0),
    ];
    let scenario = scene("queue", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    let reactions: Vec<usize> =
        ["first", "second", "third"].map(|id| response(&certificate, id).reaction_step).to_vec();
    assert!(reactions[0] <= reactions[1] && reactions[1] <= reactions[2], "{reactions:?}");
}

#[test]
fn who_only_meets_the_braking_leader_reacts_to_that() {
    // The AV stops in the middle of a crossing. Only the first vehicle would get there; the second would end
    // just before it.
    let north = |id: &str, y: f64| car(id, 30.0, y, FRAC_PI_2, 10.0);
    let agents = vec![car("av", 0.0, 0.0, 0.0, 10.0), north("first", -71.0), north("second", -85.0)];
    let scenario = scene("second row", agents, straight());
    let av = braking(&scenario, 2.0, 0.5);
    let certificate = found(&scenario, &av);
    let (first, second) = (response(&certificate, "first"), response(&certificate, "second"));
    assert!(second.reaction_step > first.reaction_step, "{} {}", first.reaction_step, second.reaction_step);
}

/// Returns a crossing: the AV drives east and stops in the middle; `own` comes from the south.
fn crossing(gap: f64) -> (Scenario, Vec<AgentState>) {
    let mut map = straight();
    map.lanes.push(lane("north", line((30.0, -150.0), (30.0, 150.0)), Some(15.0)));
    let agents = vec![car("av", 0.0, 0.0, 0.0, 10.0), car("own", 30.0, -gap, FRAC_PI_2, 10.0)];
    let scenario = scene(&format!("crossing from {gap} m"), agents, map);
    let av = braking(&scenario, 2.0, 0.5);
    (scenario, av)
}

#[test]
fn a_crossing_car_yields_or_goes_first() {
    let (scenario, av) = crossing(45.0);
    // In the log it passes after 3.0 s; the AV stops in the middle of the crossing after 5.5 s.
    let end = av[FUTURE].x;
    assert!((27.0..33.0).contains(&end), "the AV stops at {end}");
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.track[FUTURE].y < -1.0 || own.track[FUTURE].y > 5.0);
}

#[test]
fn head_on_there_is_no_way_out() {
    let agents = vec![car("av", 60.0, 3.6, PI, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("head-on", agents, straight());
    // The AV moves over into the lane of the oncoming car and drives on.
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 1.5).min(1.0);
        AgentState { y: 3.6 * (1.0 - share * share * (3.0 - 2.0 * share)), ..s }
    });
    let why = refused(&scenario, &av);
    assert!(matches!(why, Unavoidable::TooClose { .. }), "{why}");
    assert!(why.to_string().contains("`own`"), "{why}");
}

#[test]
fn a_cut_in_at_arms_length_is_too_close() {
    let agents = vec![car("av", 8.0, -3.6, 0.0, 15.0), car("own", 0.0, 0.0, 0.0, 15.0)];
    let scenario = scene("cut-in", agents, straight());
    // Within 1 s the AV is in front of the other car, and 9 m/s slower.
    let mut x = scenario.start.now(0).x;
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT).min(1.0);
        let speed = 15.0 - 9.0 * share;
        x += if k == 0 { 0.0 } else { speed * DT };
        AgentState { x, y: -3.6 * (1.0 - share), vx: speed, ..s }
    });
    let why = refused(&scenario, &av);
    assert!(matches!(why, Unavoidable::TooClose { .. } | Unavoidable::TooEarly { .. }), "{why}");
}

#[test]
fn a_conflict_before_anybody_can_react_is_refused() {
    let agents = vec![car("av", 5.3, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("tailgating", agents, straight());
    let why = refused(&scenario, &braking(&scenario, 6.0, 0.0));
    assert!(matches!(why, Unavoidable::TooEarly { reaction: 5 | 6, .. }), "{why}");
}

#[test]
fn a_nudge_saves_where_braking_can_not() {
    // The oncoming AV protrudes half a metre into the lane of the other car, all the way: stopping does not
    // help.
    let mut map = straight();
    map.lanes.push(lane("right", line((-150.0, -3.5), (350.0, -3.5)), Some(15.0)));
    let (scenario, av) = narrow(map, Vec::new());
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.nudge < 0.0 && own.nudge >= -1.0, "{}", own.nudge);
    let never = AvoidanceSettings { max_nudge: 0.0, ..AvoidanceSettings::default() };
    assert!(matches!(certify(&scenario, &av, &never), Err(Unavoidable::TooClose { .. })));
}

#[test]
fn a_pedestrian_waits() {
    let walker = agent("walker", AgentKind::Pedestrian, state(30.0, -7.0, FRAC_PI_2, 1.4));
    let scenario = scene("walker", vec![car("av", -30.0, 0.0, 0.0, 14.0), walker], straight());
    // In the log the AV has passed before the pedestrian comes; the candidate is slower.
    let av = candidate(&scenario, |k, s| {
        let now = later(&AgentState { x: -30.0, vx: 12.0, ..s }, k as f64 * DT);
        AgentState { x: now.x, vx: 12.0, ..s }
    });
    let certificate = found(&scenario, &av);
    for response in &certificate.responses {
        assert_eq!((response.agent.as_str(), response.nudge), ("walker", 0.0));
    }
}

#[test]
fn a_standing_car_that_is_run_into_can_do_nothing() {
    // The AV moves over and drives into it; or it comes slowly, and there would be time to drive off.
    for (speed, from) in [(10.0, 0.0), (3.0, 24.0)] {
        let agents = vec![car("av", from, 3.6, 0.0, speed), car("own", 40.0, 0.0, 0.0, 0.0)];
        let scenario = scene("standing", agents, straight());
        let av = candidate(&scenario, |k, s| {
            let share = (k as f64 * DT / 2.0).min(1.0);
            AgentState { y: 3.6 * (1.0 - share), ..s }
        });
        let why = refused(&scenario, &av);
        assert!(matches!(why, Unavoidable::Standing { .. }), "{why}");
        assert!(why.to_string().contains("`own`"), "{why}");
    }
}

/// Returns a vehicle along a path: `at` gives position and heading by arc length, `speed` the speed by time;
/// the arc length is 0 now.
fn along(id: &str, at: impl Fn(f64) -> (Vec2, f64), speed: impl Fn(f64) -> f64) -> LoggedAgent {
    let mut own = car(id, 0.0, 0.0, 0.0, 0.0);
    let mut s = -speed(0.0) * CURRENT as f64 * DT;
    for (f, frame) in own.track.iter_mut().enumerate() {
        let v = speed((f as f64 - CURRENT as f64) * DT);
        s += if f == 0 { 0.0 } else { v * DT };
        let ((p, heading), v) = (at(s), direction(at(s).1) * v);
        *frame = Some(AgentState { x: p.x, y: p.y, heading, vx: v.x, vy: v.y });
    }
    own
}

/// Returns position and heading by arc length: straight on to the east for 30 m, then a left turn of 8 m
/// radius, and north.
fn bend(s: f64) -> (Vec2, f64) {
    let turned = ((s - 30.0) / 8.0).clamp(0.0, FRAC_PI_2);
    let rest = (s - 30.0 - 8.0 * FRAC_PI_2).max(0.0);
    let corner = Vec2::new(s.min(30.0) + 8.0 * turned.sin(), 8.0 * (1.0 - turned.cos()) + rest);
    (corner, turned)
}

/// Returns the AV's log as a candidate that goes along the x axis from `from` on, at a speed by time.
fn eastward(scenario: &Scenario, from: f64, speed: impl Fn(f64) -> f64) -> Vec<AgentState> {
    let (mut x, now) = (from, scenario.start.now(0));
    candidate(scenario, |k, _| {
        let v = speed(k as f64 * DT);
        x += if k == 0 { 0.0 } else { v * DT };
        AgentState { x, vx: v, vy: 0.0, ..now }
    })
}

/// Returns the logged tracks of all agents, with the candidate as that of the AV.
fn with_av(scenario: &Scenario, av: &[AgentState]) -> Vec<Vec<Frame>> {
    let mut tracks: Vec<Vec<Frame>> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    tracks[0].truncate(CURRENT + 1);
    tracks[0].extend(av[1..].iter().copied().map(Some));
    tracks
}

#[test]
fn nobody_escapes_through_a_bend_faster_than_its_tyres_allow() {
    // The vehicle slows from 12 to 5 m/s before the bend, and takes it at 5 m/s. The AV behind it does
    // likewise in the log, but as a candidate goes on at 11 m/s: the quickest way out is to take 8 m of
    // radius at 12 m/s.
    let speed = |t: f64| (12.0 - 2.5 * (t - 0.5).max(0.0)).max(5.0);
    for gap in [12.0, 14.0, 16.0, 18.0, 20.0, 22.0] {
        let av = along("av", |s| (Vec2::new(s - gap, 0.0), 0.0), speed);
        let scenario = scene(&format!("bend {gap}"), vec![av, along("own", bend, speed)], straight());
        let av = eastward(&scenario, -gap, |t| speed(t).max(11.0));
        if let Ok(certificate) = certify(&scenario, &av, &AvoidanceSettings::default()) {
            recheck(&scenario, &av, &certificate);
        }
    }
}

#[test]
fn who_comes_late_to_a_bend_takes_it_slowly_all_the_same() {
    // After the bend the log is at 12 m/s again; the AV ahead, which goes straight on, delays the vehicle, so
    // that it is still in the bend then.
    let speed = |t: f64| match t < 5.9 {
        true => (12.0 - 2.5 * (t - 0.5).max(0.0)).max(5.0),
        false => (5.0 + 3.5 * (t - 5.9)).min(12.0),
    };
    let agents = vec![car("av", 14.0, 0.0, 0.0, 12.0), along("own", bend, speed)];
    let scenario = scene("late to the bend", agents, straight());
    let braked = |t: f64| (12.0 - 5.0 * t).max(1.0);
    let av =
        eastward(&scenario, 14.0, |t| if t < 3.5 { braked(t) } else { (1.0 + 3.0 * (t - 3.5)).min(12.0) });
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.track[FUTURE].y > 0.5, "it is in the bend: {}", own.track[FUTURE].y);
}

#[test]
fn who_stops_in_its_log_does_not_drive_on() {
    // Both stop in the log; the candidate does not, and drives into the other one from behind. Driving on in
    // front of it would be a way out.
    let speed = |t: f64| (10.0 - 5.0 / 3.0 * t).max(0.0);
    let at = |s: f64| (Vec2::new(s, 0.0), 0.0);
    let own = along("own", at, speed);
    let av = along("av", |s| (Vec2::new(s - 14.0, 0.0), 0.0), speed);
    let scenario = scene("stopping", vec![av, own], straight());
    let why = refused(&scenario, &eastward(&scenario, -14.0, |t| speed(t).max(6.0)));
    assert!(matches!(why, Unavoidable::TooClose { .. }), "{why}");
}

#[test]
fn one_frame_of_overlap_in_the_log_excuses_that_frame_only() {
    let mut behind = car("behind", -14.0, 0.0, 0.0, 10.0);
    // An error of the recording: for one frame it overlaps the other one.
    if let Some(state) = &mut behind.track[CURRENT + 2] {
        state.x += 12.0;
    }
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0), behind];
    let scenario = scene("slip", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    response(&certificate, "behind");
}

/// Returns a road on which the oncoming AV moves over into the lane of `own`, and agents beside it.
fn narrow(map: MapParts, beside: Vec<LoggedAgent>) -> (Scenario, Vec<AgentState>) {
    let mut agents = vec![car("av", 80.0, 3.2, PI, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    agents.extend(beside);
    let scenario = scene("narrow", agents, map);
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 1.5).min(1.0);
        AgentState { y: 3.2 - 1.6 * share * share * (3.0 - 2.0 * share), ..s }
    });
    (scenario, av)
}

#[test]
fn a_nudge_keeps_clear_of_what_stands_around() {
    let cone = |i: u8| {
        agent(&format!("cone {i}"), AgentKind::Other, state(20.0 + 6.0 * f64::from(i), -1.45, 0.0, 0.0))
    };
    let (scenario, av) = narrow(straight(), Vec::new());
    assert!(response(&found(&scenario, &av), "own").nudge < 0.0);
    let (scenario, av) = narrow(straight(), (0..8).map(cone).collect());
    assert_eq!(scenario.start.obstacles.len(), 8);
    assert!(matches!(refused(&scenario, &av), Unavoidable::TooClose { .. }));
}

#[test]
fn a_nudge_keeps_its_corners_on_the_road() {
    let ground = |right: f64| {
        let corners = [(-200.0, right), (400.0, right), (400.0, 9.0), (-200.0, 9.0)];
        let exterior = corners.map(|(x, y)| Vec2::new(x, y)).to_vec();
        MapParts { drivable_area: Some(vec![Polygon { exterior, holes: Vec::new() }]), ..straight() }
    };
    let (scenario, av) = narrow(ground(-2.5), Vec::new());
    assert!(response(&found(&scenario, &av), "own").nudge < 0.0);
    // The centre stays on the drivable area, a corner does not.
    let (scenario, av) = narrow(ground(-1.2), Vec::new());
    assert!(matches!(refused(&scenario, &av), Unavoidable::TooClose { .. }));
}

#[test]
fn a_case_that_is_there_already_gives_the_same_certificate() {
    let (scenario, av) = crossing(45.0);
    let case = Case::of_rollout(&scenario, with_av(&scenario, &av), Options::default());
    let settings = AvoidanceSettings::default();
    assert_eq!(certify_case(&scenario, &av, &case, &settings).unwrap(), found(&scenario, &av));
    let malformed = certify_case(&scenario, &av[1..], &case, &settings);
    assert_eq!(malformed, Err(Unavoidable::Malformed { found: 80, expected: 81 }));
}

#[test]
fn driving_the_certificate_is_no_over_reaction() {
    let (scenario, av) = crossing(45.0);
    let certificate = found(&scenario, &av);
    let mut tracks = with_av(&scenario, &av);
    for response in &certificate.responses {
        let agent = scenario.start.agents.iter().position(|a| a.id == response.agent).unwrap();
        tracks[agent].truncate(CURRENT + 1);
        // As in the engine, velocities are position differences.
        let unknown = |s: &AgentState| AgentState { vx: f64::NAN, vy: f64::NAN, ..*s };
        tracks[agent].extend(response.track[1..].iter().map(|s| Some(unknown(s))));
    }
    let case = Case::of_rollout(&scenario, tracks, Options::default());
    let scores = score_case(&case.with_certificate(Some(&certificate)));
    assert_eq!(scores.value("over-reaction"), Some(0.0));
    assert!(scores.value("over-braking").unwrap() < 0.1, "{:?}", scores.value("over-braking"));
}

#[test]
fn candidates_of_the_wrong_form_are_refused() {
    let scenario = scene("form", vec![car("av", 0.0, 0.0, 0.0, 10.0)], MapParts::default());
    let mut av = candidate(&scenario, |_, s| s);
    av[7].x = f64::NAN;
    assert_eq!(refused(&scenario, &av), Unavoidable::Malformed { found: 80, expected: 81 });
    assert_eq!(refused(&scenario, &av[..7]), Unavoidable::Malformed { found: 7, expected: 81 });
    assert_eq!(refused(&scenario, &[]), Unavoidable::Malformed { found: 0, expected: 81 });
}

#[test]
fn an_agent_with_gaps_in_its_log_is_no_trouble() {
    let mut own: LoggedAgent = car("own", 0.0, 0.0, 0.0, 10.0);
    for frame in [CURRENT + 3, CURRENT + 7, CURRENT + 20] {
        own.track[frame] = None;
    }
    for frame in CURRENT + 60..own.track.len() {
        own.track[frame] = None;
    }
    let scenario = scene("gaps", vec![car("av", 20.0, 0.0, 0.0, 10.0), own], straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    assert_eq!(response(&certificate, "own").track.len(), FUTURE + 1);
}

#[test]
fn certificates_of_real_logs_hold() {
    let scenarios = real(24);
    if scenarios.is_empty() {
        // There are no data next to the repository.
        return;
    }
    let (mut conflicts, mut certified) = (0, 0);
    for (scenario, script) in scenarios.iter().flat_map(|s| {
        ["brake:3", "retime:0.5", "retime:1.5", "shift:-2", "shift:2"].map(|script| (s, script))
    }) {
        let Ok(av) = ScriptedAv::new(scenario, script.parse().unwrap()) else { continue };
        let track: Vec<AgentState> =
            std::iter::once(scenario.start.now(0)).chain(av.track().iter().copied()).collect();
        let certificate = certify(scenario, &track, &AvoidanceSettings::default());
        if let Ok(certificate) = &certificate {
            recheck(scenario, &track, certificate);
        }
        let responds = certificate.as_ref().map_or(0, |c| c.responses.len());
        // An AV that only brakes leaves the others a way out.
        if script == "brake:3" && (certificate.is_err() || responds > 0) {
            conflicts += 1;
            certified += usize::from(certificate.is_ok());
        }
    }
    assert!(certified * 10 >= conflicts * 8, "{certified} of {conflicts} are certified");
    assert!(certified > 3, "{certified} certificates");
}
