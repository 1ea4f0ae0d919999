//! Following, and stopping behind obstacles (waymax #42, #52 and #71: IDM drives into stopped cars, and
//! drives pedestrians).

use reactsim::rollout::Settings;
use reactsim::scene::{AgentKind, AgentState, DT, FUTURE, LoggedAgent};

use super::{braking_within_limits, last_speed, no_contact};
use crate::scenes::{agent, bystander, car, contact, future, idm, later, roll_with, scene, state, straight};

/// Returns obstacles that stand in a lane, `at` metres along it.
fn standing(at: f64) -> Vec<(&'static str, Vec<LoggedAgent>)> {
    let own = |what: LoggedAgent| vec![bystander(), what];
    vec![
        ("broken-down car", own(car("what", at, 0.2, 0.7, 0.0))),
        ("car across the lane", own(car("what", at, 0.0, 1.6, 0.0))),
        ("pedestrian", own(agent("what", AgentKind::Pedestrian, state(at, 0.1, 1.5, 0.0)))),
        ("cyclist", own(agent("what", AgentKind::Cyclist, state(at, 0.0, 1.57, 0.0)))),
        ("stopped AV", vec![car("av", at, 0.0, 0.0, 0.0)]),
    ]
}

#[test]
fn stops_behind_what_stands_in_its_lane() {
    for gap in [32.0, 45.0, 70.0] {
        for (name, mut agents) in standing(gap + 4.6) {
            agents.push(car("own", 0.0, 0.0, 0.0, 15.0));
            let scenario = scene(&format!("{name} {gap} m ahead"), agents, straight());
            let rollout = idm(&scenario);
            no_contact(&scenario, &rollout);
            let track = braking_within_limits(&scenario, &rollout, "own");
            // From 70 m away there is hardly time for a comfortable complete stop.
            let standing = if gap < 60.0 { 0.5 } else { 2.0 };
            assert!(last_speed(&track) < standing, "{}: still {:.1} m/s", scenario.id, last_speed(&track));
            let room = gap + 4.6 - track[FUTURE].x;
            assert!(room < 14.0, "{}: stops {room:.1} m before it", scenario.id);
        }
    }
}

#[test]
fn stops_behind_static_context_too() {
    let cone = agent("cone", AgentKind::Other, state(45.0, 0.0, 0.0, 0.0));
    let scenario = scene("cone", vec![bystander(), cone, car("own", 0.0, 0.0, 0.0, 15.0)], straight());
    let rollout = idm(&scenario);
    let track = braking_within_limits(&scenario, &rollout, "own");
    assert_eq!(scenario.start.obstacles.len(), 1);
    let (own, cone) = (&scenario.start.agents[1], scenario.start.obstacles[0]);
    for s in &track {
        assert!(s.footprint(own).separation(&cone) > 0.0, "over the cone at x = {:.1}", s.x);
    }
}

#[test]
fn braking_for_what_is_far_is_comfortable() {
    let scenario =
        scene("far", vec![car("av", 90.0, 0.0, 0.0, 0.0), car("own", 0.0, 0.0, 0.0, 14.0)], straight());
    let rollout = idm(&scenario);
    let track = braking_within_limits(&scenario, &rollout, "own");
    let hardest = crate::scenes::accelerations(&track).into_iter().fold(0.0, f64::min);
    assert!(hardest > -3.2, "{hardest:.2} m/s2 for a car 90 m ahead");
}

#[test]
fn a_queue_closes_up_without_contact() {
    let mut agents = vec![car("av", 60.0, 0.0, 0.0, 0.0)];
    for k in 0..5 {
        agents.push(car(&format!("q{k}"), 20.0 - 22.0 * f64::from(k), 0.0, 0.0, 13.0));
    }
    let scenario = scene("queue", agents, straight());
    let rollout = idm(&scenario);
    no_contact(&scenario, &rollout);
    for k in 0..5 {
        braking_within_limits(&scenario, &rollout, &format!("q{k}"));
    }
}

#[test]
fn an_av_that_brakes_hard_is_not_hit() {
    for (gap, speed) in [(10.0, 8.0), (16.0, 12.0), (22.0, 15.0)] {
        let agents = vec![car("av", gap + 4.6, 0.0, 0.0, speed), car("own", 0.0, 0.0, 0.0, speed)];
        let scenario = scene(&format!("brakes {gap}"), agents, straight());
        let now = scenario.start.now(0);
        let brakes = |k: usize| {
            let t = (k as f64 * DT).min(speed / 5.0);
            AgentState { x: now.x + speed * t - 2.5 * t * t, vx: speed - 5.0 * t, ..now }
        };
        let av: Vec<AgentState> = (1..=FUTURE).map(brakes).collect();
        let rollout = roll_with("idm", &scenario, av, &Settings::default(), 0);
        no_contact(&scenario, &rollout);
        braking_within_limits(&scenario, &rollout, "own");
    }
}

#[test]
fn a_vehicle_only_partly_in_the_lane_is_a_leader() {
    // A slow AV comes over from the right and stays on the line: only a part of it is in the lane.
    for depth in [0.4, 0.7, 1.0] {
        let agents = vec![car("av", 22.0, -3.4, 0.0, 7.0), car("own", 0.0, 0.0, 0.0, 13.0)];
        let scenario = scene(&format!("cut-in {depth}"), agents, straight());
        let now = scenario.start.now(0);
        let to = -0.95 - 0.95 + depth;
        let mut before = now;
        let moves = |k: usize| {
            let share = (k as f64 * DT / 2.0).min(1.0);
            let y = now.y + (to - now.y) * share * share * (3.0 - 2.0 * share);
            let next = AgentState { y, ..later(&now, k as f64 * DT) };
            let heading = (next.y - before.y).atan2(next.x - before.x);
            before = next;
            AgentState { heading, ..next }
        };
        let av: Vec<AgentState> = (1..=FUTURE).map(moves).collect();
        let rollout = roll_with("idm", &scenario, av, &Settings::default(), 0);
        no_contact(&scenario, &rollout);
        braking_within_limits(&scenario, &rollout, "own");
    }
}

#[test]
fn a_fast_av_from_behind_finds_the_lane_clear() {
    let mut map = straight();
    map.lanes.push(crate::scenes::lane("left", crate::scenes::line((-150.0, 3.5), (350.0, 3.5)), Some(15.0)));
    for (gap, own, av) in [(40.0, 8.0, 16.0), (60.0, 6.0, 18.0), (35.0, 11.0, 17.0)] {
        let agents = vec![car("av", -gap, 0.0, 0.0, av), car("own", 0.0, 0.0, 0.0, own)];
        let scenario = scene(&format!("from behind at {av}"), agents, map.clone());
        let rollout = idm(&scenario);
        assert_eq!(contact(&scenario, &rollout), None, "{}: there is room aside", scenario.id);
    }
}

#[test]
fn pedestrians_walk_on_and_are_not_driven() {
    let walker =
        |id: &str, x, y, heading, speed| agent(id, AgentKind::Pedestrian, state(x, y, heading, speed));
    // No lane leads where they go; one walks backwards, one along the middle of the road.
    let agents = vec![
        bystander(),
        walker("beside", 0.0, 6.0, 0.4, 1.4),
        walker("on the road", 60.0, 0.0, 0.0, 1.2),
        walker("runner", -60.0, -30.0, 2.0, 3.1),
        walker("stands", 20.0, -8.0, 0.0, 0.0),
    ];
    let mut agents = agents;
    for state in agents[1].track.iter_mut().flatten() {
        state.heading += std::f64::consts::PI;
    }
    let scenario = scene("walkers", agents, straight());
    let rollout = idm(&scenario);
    for (id, speed) in [("beside", 1.4), ("on the road", 1.2), ("runner", 3.1), ("stands", 0.0)] {
        let track = future(&scenario, &rollout, id);
        let (now, then) = (&track[0], &track[FUTURE]);
        let way = (then.position() - now.position()).norm();
        assert!((way - speed * 8.0).abs() < 0.1 * speed * 8.0 + 0.01, "`{id}` went {way:.1} m");
        let off = (then.position() - later(now, 8.0).position()).norm();
        assert!(off < 0.1 * speed * 8.0 + 0.01, "`{id}` is {off:.1} m from where it was going");
    }
}

#[test]
fn pedestrians_wait_for_a_vehicle_they_would_walk_into() {
    for start in [5.2, 5.8, 6.4] {
        // Both would be at x = 40 at the same time.
        let walker =
            agent("walker", AgentKind::Pedestrian, state(40.0, -start, std::f64::consts::FRAC_PI_2, 1.4));
        let scenario = scene(
            &format!("walker {start} m aside"),
            vec![car("av", 0.0, 0.0, 0.0, 10.0), walker],
            straight(),
        );
        let rollout = idm(&scenario);
        no_contact(&scenario, &rollout);
        let track = future(&scenario, &rollout, "walker");
        assert!(track[FUTURE].y > 1.0, "{}: never crosses: y = {:.1}", scenario.id, track[FUTURE].y);
    }
}

#[test]
fn an_oncoming_neighbour_is_no_reason_to_stop() {
    let mut map = straight();
    map.lanes.push(crate::scenes::lane("back", crate::scenes::line((350.0, 3.6), (-150.0, 3.6)), Some(15.0)));
    let agents = vec![
        bystander(),
        car("own", 0.0, 0.0, 0.0, 12.0),
        car("oncoming", 100.0, 3.6, std::f64::consts::PI, 12.0),
    ];
    let scenario = scene("oncoming", agents, map);
    let rollout = idm(&scenario);
    no_contact(&scenario, &rollout);
    for id in ["own", "oncoming"] {
        let slowest =
            future(&scenario, &rollout, id).iter().map(AgentState::speed).fold(f64::INFINITY, f64::min);
        assert!(slowest > 11.0, "`{id}` slows to {slowest:.1} m/s");
    }
}
