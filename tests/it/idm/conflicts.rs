//! Crossing and merging: nobody is hit, and nobody waits forever.

use std::f64::consts::FRAC_PI_2;

use reactsim::geometry::Vec2;
use reactsim::scene::{
    AgentKind, AgentState, FUTURE, LoggedAgent, MapParts, Scenario, StopKind, StopLineParts,
};

use super::{HARDEST, braking_within_limits, no_contact};
use crate::scenes::{
    accelerations, agent, bystander, car, contact, future, idm, join, lane, line, scene, state,
};

/// Returns four straight lanes through a junction at the origin: east, west, north, south.
fn crossing() -> MapParts {
    let lanes = vec![
        lane("east", line((-150.0, -1.8), (200.0, -1.8)), Some(13.0)),
        lane("west", line((150.0, 1.8), (-200.0, 1.8)), Some(13.0)),
        lane("north", line((1.8, -150.0), (1.8, 200.0)), Some(13.0)),
        lane("south", line((-1.8, 150.0), (-1.8, -200.0)), Some(13.0)),
    ];
    MapParts { lanes, ..MapParts::default() }
}

/// Returns a vehicle on one of the arms, `before` metres before the middle.
fn on_arm(arm: &str, before: f64, speed: f64) -> LoggedAgent {
    match arm {
        "east" => car(arm, -before, -1.8, 0.0, speed),
        "west" => car(arm, before, 1.8, 2.0 * FRAC_PI_2, speed),
        "north" => car(arm, 1.8, -before, FRAC_PI_2, speed),
        _ => car(arm, -1.8, before, -FRAC_PI_2, speed),
    }
}

/// Returns the distance of a vehicle beyond the middle at the end, metres.
fn beyond(scenario: &Scenario, tracks: &[(String, Vec<AgentState>)], arm: &str) -> f64 {
    let Some((_, track)) = tracks.iter().find(|t| t.0 == arm) else { panic!("{}: no {arm}", scenario.id) };
    let end = &track[FUTURE];
    match arm {
        "east" => end.x,
        "west" => -end.x,
        "north" => end.y,
        _ => -end.y,
    }
}

/// Rolls out and returns the distance of each vehicle beyond the middle and its speed, or a message if agents
/// overlap or brake too hard.
fn try_meet(
    id: &str,
    agents: Vec<LoggedAgent>,
    map: MapParts,
    arms: &[&str],
) -> Result<Vec<(f64, f64)>, String> {
    let scenario = scene(id, agents, map);
    let rollout = idm(&scenario);
    if let Some((step, a, b)) = contact(&scenario, &rollout) {
        return Err(format!("{id}: `{a}` and `{b}` overlap at step {step}"));
    }
    let tracks: Vec<_> =
        arms.iter().map(|arm| ((*arm).to_owned(), future(&scenario, &rollout, arm))).collect();
    let hardest = tracks.iter().flat_map(|t| accelerations(&t.1)).fold(0.0, f64::min);
    if hardest < -HARDEST - 0.05 {
        return Err(format!("{id}: {hardest:.2} m/s2"));
    }
    Ok(arms
        .iter()
        .zip(&tracks)
        .map(|(arm, t)| (beyond(&scenario, &tracks, arm), t.1[FUTURE].speed()))
        .collect())
}

/// As [`try_meet`], but panics with the message.
#[track_caller]
fn meet(id: &str, agents: Vec<LoggedAgent>, map: MapParts, arms: &[&str]) -> Vec<(f64, f64)> {
    try_meet(id, agents, map, arms).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn two_that_cross_at_the_same_time_both_get_through() {
    let (mut failures, mut cases) = (Vec::new(), 0);
    for (first, second) in [("east", "north"), ("north", "west"), ("south", "east")] {
        for (before, speed) in [(40.0, 10.0), (30.0, 8.0), (55.0, 13.0)] {
            for lead in [-6.0, -4.0, -2.0, 0.0, 1.5, 3.0, 5.0] {
                let agents =
                    vec![bystander(), on_arm(first, before, speed), on_arm(second, before + lead, speed)];
                let id = format!("{first} and {second}, {before} m at {speed}, lead {lead}");
                cases += 1;
                match try_meet(&id, agents, crossing(), &[first, second]) {
                    Err(what) => failures.push(what),
                    Ok(ends) if ends.iter().all(|e| e.0 <= 6.0) => {
                        failures.push(format!("{id}: deadlock: {ends:?}"))
                    }
                    Ok(ends) if ends.iter().any(|e| e.0 <= 6.0 && e.1 < 0.5) => {
                        failures.push(format!("{id}: one has not started again: {ends:?}"));
                    }
                    Ok(_) => {}
                }
            }
        }
    }
    assert!(failures.is_empty(), "{} of {cases}:\n{}", failures.len(), failures.join("\n"));
}

#[test]
fn standing_starts_do_not_block_each_other() {
    let arms = ["east", "north", "west", "south"];
    for n in 2..=3 {
        let mut agents = vec![bystander()];
        agents.extend(arms[..n].iter().map(|arm| on_arm(arm, 9.0, 0.0)));
        let id = format!("{n} standing starts");
        let ends = meet(&id, agents, crossing(), &arms[..n]);
        assert!(ends.iter().any(|e| e.0 > 6.0), "{id}: nobody gets through: {ends:?}");
        assert!(
            ends.iter().filter(|e| e.0 > 6.0 || e.1 > 0.3).count() >= 2,
            "{id}: only one moves: {ends:?}"
        );
    }
}

#[test]
fn an_all_way_stop_is_shared() {
    let mut map = crossing();
    for (lane, at) in
        [("east", (-8.0, -1.8)), ("north", (1.8, -8.0)), ("west", (8.0, 1.8)), ("south", (-1.8, 8.0))]
    {
        let at = Vec2::new(at.0, at.1);
        map.stop_lines.push(StopLineParts { kind: StopKind::Sign, lane: lane.into(), at });
    }
    let arms = ["east", "north"];
    let mut agents = vec![bystander()];
    agents.extend(arms.iter().map(|arm| on_arm(arm, 16.0, 4.0)));
    let ends = meet("all-way stop", agents, map, &arms);
    assert!(ends.iter().any(|e| e.0 > 3.0), "nobody gets through: {ends:?}");
}

#[test]
fn yields_to_an_av_that_crosses() {
    for lead in [-8.0, -3.0, 0.0, 3.0, 8.0] {
        let mut av = on_arm("north", 40.0 + lead, 10.0);
        av.agent.id = "av".into();
        let ends = meet(
            &format!("AV crosses, lead {lead}"),
            vec![av, on_arm("east", 40.0, 10.0)],
            crossing(),
            &["east"],
        );
        assert!(ends[0].0 > 6.0 || ends[0].1 > 0.5, "lead {lead}: waits for ever: {ends:?}");
    }
}

/// Returns two lanes that become one at the origin.
fn merging() -> MapParts {
    let mut lanes = vec![
        lane("a", line((-120.0, 0.0), (0.0, 0.0)), Some(14.0)),
        lane("b", line((-120.0, -30.0), (0.0, 0.0)), Some(14.0)),
        lane("on", line((0.0, 0.0), (300.0, 0.0)), Some(14.0)),
    ];
    join(&mut lanes, "a", "on");
    join(&mut lanes, "b", "on");
    MapParts { lanes, ..MapParts::default() }
}

#[test]
fn two_that_merge_go_one_behind_the_other() {
    let along = (30.0_f64).atan2(120.0);
    for lead in [-6.0, -2.0, 0.0, 2.0, 6.0] {
        for speed in [8.0, 12.0] {
            let d = 45.0 + lead;
            let b = car("b", -d * along.cos(), -d * along.sin(), along, speed);
            let scenario = scene(
                &format!("merge {lead} at {speed}"),
                vec![bystander(), car("a", -45.0, 0.0, 0.0, speed), b],
                merging(),
            );
            let rollout = idm(&scenario);
            no_contact(&scenario, &rollout);
            for id in ["a", "b"] {
                let track = braking_within_limits(&scenario, &rollout, id);
                let end = &track[FUTURE];
                assert!(
                    end.x > 0.0 || end.speed() > 1.0,
                    "{}: `{id}` stands at x = {:.1}",
                    scenario.id,
                    end.x
                );
            }
        }
    }
}

#[test]
fn turning_vehicles_let_people_cross() {
    let mut map = crossing();
    let turn = crate::scenes::arc((-8.0, -1.8), 0.0, 9.0, -FRAC_PI_2);
    let end = turn[turn.len() - 1];
    map.lanes.push(lane("approach", line((-100.0, -1.8), (-8.0, -1.8)), Some(8.0)));
    map.lanes.push(lane("right", turn, Some(8.0)));
    map.lanes.push(lane("exit", line((end.x, end.y), (end.x, end.y - 100.0)), Some(8.0)));
    map.lanes.retain(|l| ["approach", "right", "exit"].contains(&l.id.as_str()));
    join(&mut map.lanes, "approach", "right");
    join(&mut map.lanes, "right", "exit");
    for ahead in [2.0, 3.5, 5.0] {
        // A pedestrian crosses the exit while the vehicle turns into it.
        let walker = agent("walker", AgentKind::Pedestrian, state(end.x - ahead, end.y - 2.0, 0.0, 1.3));
        let own = car("own", -22.0, -1.8, 0.0, 6.0);
        let scenario = scene(&format!("walker {ahead}"), vec![bystander(), own, walker], map.clone());
        let rollout = idm(&scenario);
        no_contact(&scenario, &rollout);
        braking_within_limits(&scenario, &rollout, "own");
        let walked = future(&scenario, &rollout, "walker")[FUTURE].x - (end.x - ahead);
        assert!(walked > 3.0, "{}: the walker is held up: {walked:.1} m", scenario.id);
    }
}

#[test]
fn a_cyclist_is_followed_like_a_slow_vehicle() {
    let map = MapParts {
        lanes: vec![lane("main", line((-100.0, 0.0), (300.0, 0.0)), Some(13.0))],
        ..MapParts::default()
    };
    let rider = agent("rider", AgentKind::Cyclist, state(35.0, 0.3, 0.0, 4.0));
    let scenario = scene("rider", vec![bystander(), rider, car("own", 0.0, 0.0, 0.0, 12.0)], map);
    let rollout = idm(&scenario);
    no_contact(&scenario, &rollout);
    let own = braking_within_limits(&scenario, &rollout, "own");
    assert!(own[FUTURE].speed() < 7.0, "{:.1} m/s behind a cyclist", own[FUTURE].speed());
    let rider = future(&scenario, &rollout, "rider");
    assert!(rider[FUTURE].speed() > 3.0 && rider[FUTURE].speed() < 7.5, "{:.1} m/s", rider[FUTURE].speed());
}
