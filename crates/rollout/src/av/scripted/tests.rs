use proptest::prelude::*;
use reactsim_geometry::{Polyline, Vec2, wrap};
use reactsim_scene::{
    Agent, AgentKind, CURRENT, FRAMES, FUTURE, Frame, LaneParts, LoggedAgent, MapParts, ScenarioParts,
};

use super::*;

/// Returns a scenario with nothing but an AV.
fn alone(track: Vec<Frame>, lanes: Vec<LaneParts>) -> Scenario {
    let agent = Agent { id: "av".into(), kind: AgentKind::Vehicle, length: 4.8, width: 2.0 };
    let map = MapParts { lanes, ..MapParts::default() };
    let agents = vec![LoggedAgent { agent, track, heights: Vec::new() }];
    Scenario::assemble(ScenarioParts { id: "alone".into(), agents, map, ..ScenarioParts::default() }).unwrap()
}

/// Returns the frames of a vehicle driven by its rear axle: speeds and curvatures per frame, with noise
/// on the recorded poses.
fn drive(speeds: &[f64], curvatures: &[f64], noise: &[(f64, f64)]) -> Vec<Frame> {
    let (mut axle, mut heading) = (Vec2::new(40.0, -7.0), 0.7);
    let mut track: Vec<Frame> = Vec::new();
    for k in 0..FRAMES {
        let (v, bend) = (speeds[k], curvatures[k]);
        for _ in 0..10 {
            axle += direction(heading) * (v * 0.01);
            heading += bend * v * 0.01;
        }
        let (along, turn) = noise.get(k).copied().unwrap_or_default();
        let p = axle + direction(heading) * (1.344 + along);
        let mut state =
            AgentState { x: p.x, y: p.y, heading: wrap(heading + turn), vx: f64::NAN, vy: f64::NAN };
        let v = direction(heading) * v;
        (state.vx, state.vy) = (v.x, v.y);
        track.push(Some(state));
    }
    track
}

fn steady(speed: f64, curvature: f64) -> Scenario {
    alone(drive(&[speed; FRAMES], &[curvature; FRAMES], &[]), Vec::new())
}

fn plan(scenario: &Scenario, script: &str) -> Vec<AgentState> {
    ScriptedAv::new(scenario, script.parse().unwrap()).unwrap().track
}

#[test]
fn a_log_that_jumps_is_refused() {
    let mut track = drive(&[10.0; FRAMES], &[0.0; FRAMES], &[]);
    for state in track[40..].iter_mut().flatten() {
        state.x += 50_000.0;
    }
    let refused = ScriptedAv::new(&alone(track, Vec::new()), Script::Retime(3.0)).unwrap_err();
    assert!(refused.0.contains("between steps 29 and 30"), "{refused}");
}

/// Checks sections 7 and 8 of the metrics at every transition from the current frame on.
fn obeys(now: &AgentState, track: &[AgentState]) -> Result<(), String> {
    let (mut before, mut v0) = (*now, now.speed());
    for (k, state) in track.iter().enumerate() {
        let v1 = (state.position() - before.position()).norm() / DT;
        let a = (v1 - v0) / DT;
        if a.abs() > 6.001 {
            return Err(format!("step {}: acceleration {a}", k + 1));
        }
        let bend = wrap(state.heading - before.heading) / (v0 * DT + 0.5 * a * DT * DT);
        if v0 >= 0.6 && v1 >= 0.6 && bend.abs() > 0.301 {
            return Err(format!("step {}: curvature {bend}", k + 1));
        }
        if (state.speed() - v1).abs() > 1e-6 {
            return Err(format!("step {}: velocity {} but moved at {v1}", k + 1, state.speed()));
        }
        if v1 == 0.0 && (state.heading != before.heading) {
            return Err(format!("step {}: turned on the spot", k + 1));
        }
        (before, v0) = (*state, v1);
    }
    Ok(())
}

#[test]
fn scripts_are_read_and_written() {
    for text in
        ["constant-velocity", "brake:4", "brake:6", "retime:1.6", "retime:0.5", "shift:-2.5", "shift:0"]
    {
        assert_eq!(text.parse::<Script>().unwrap().to_string(), text);
    }
    for text in [
        "",
        "brake",
        "brake:",
        "brake:0",
        "brake:6.1",
        "brake:nan",
        "retime:-1",
        "retime:3.5",
        "retime:inf",
        "shift:6",
        "shift:x",
        "swerve:2",
        "constant-velocity:3",
    ] {
        assert!(text.parse::<Script>().is_err(), "{text}");
    }
    insta::assert_snapshot!("brake:9".parse::<Script>().unwrap_err(), @"`brake:9` is not a scripted AV: expected `brake:` and a deceleration above 0 and at most 6 m/s², such as `brake:4`");
}

#[test]
fn an_absent_log_is_refused_by_name() {
    let mut track = drive(&[5.0; FRAMES], &[0.0; FRAMES], &[]);
    track[CURRENT + 7] = None;
    let scenario = alone(track, Vec::new());
    assert_eq!(ScriptedAv::new(&scenario, Script::Brake(3.0)).unwrap_err(), AvError::absent(7));
    assert_eq!(plan(&scenario, "constant-velocity").len(), FUTURE);
}

#[test]
fn brakes_with_the_mean_that_was_asked_and_then_stands_still() {
    for (speed, asked) in [(14.0, 4.0), (9.0, 2.0), (20.0, 5.5), (12.0, 6.0), (3.0, 4.0)] {
        let scenario = steady(speed, 0.0);
        let track = plan(&scenario, &format!("brake:{asked}"));
        obeys(&scenario.start.now(0), &track).unwrap();
        let way = (track[FUTURE - 1].position() - scenario.start.now(0).position()).norm();
        assert!((way - speed * speed / (2.0 * asked)).abs() < 0.05, "{speed} {asked}: {way}");
        let halt = track.iter().position(|s| s.speed() == 0.0).unwrap();
        assert!((halt as f64 * DT - speed / asked).abs() < 0.2, "{speed} {asked}: {halt}");
        assert!(track[halt..].iter().all(|s| s == &track[halt]));
    }
}

#[test]
fn a_standing_av_stands_exactly_still() {
    let noise: Vec<(f64, f64)> =
        (0..FRAMES).map(|k| (0.02 * (k as f64 * 2.3).sin(), 0.004 * (k as f64).cos())).collect();
    let scenario = alone(drive(&[0.0; FRAMES], &[0.0; FRAMES], &noise), Vec::new());
    let now = scenario.start.now(0);
    for script in ["constant-velocity", "brake:4", "retime:1.6", "retime:0.5", "shift:2"] {
        for state in plan(&scenario, script) {
            assert_eq!(
                (state.x, state.y, state.heading, state.speed()),
                (now.x, now.y, now.heading, 0.0),
                "{script}"
            );
        }
    }
}

#[test]
fn retime_reaches_the_factor_and_goes_on_along_its_lane() {
    // A lane that bends left after the end of the log: 80 steps of 8 m/s from x = 0.
    let mut points: Vec<Vec2> = (0..90).map(|i| Vec2::new(-10.0 + i as f64, 0.0)).collect();
    points.extend((0..120).map(|i| {
        let a = i as f64 / 70.0;
        Vec2::new(80.0 + 70.0 * a.sin(), 70.0 - 70.0 * a.cos())
    }));
    let lane = LaneParts { id: "bend".into(), points, ..LaneParts::default() };
    let track = (0..FRAMES)
        .map(|k| Some(AgentState { x: 0.8 * (k as f64 - 10.0), y: 0.0, heading: 0.0, vx: 8.0, vy: 0.0 }))
        .collect();
    let scenario = alone(track, vec![lane]);
    let track = plan(&scenario, "retime:1.6");
    obeys(&scenario.start.now(0), &track).unwrap();
    let last = track[FUTURE - 1];
    assert!((last.speed() - 12.8).abs() < 0.2, "{}", last.speed());
    let on_lane = scenario.start.road().lane(0).baseline.project(last.position()).distance;
    assert!(last.y > 0.2 && on_lane < 0.5, "{last:?}, {on_lane} m beside its lane");
    let slow = plan(&scenario, "retime:0.5");
    assert!((slow[FUTURE - 1].speed() - 4.0).abs() < 0.1);
}

#[test]
fn shift_ends_at_the_offset() {
    for (speed, curvature, asked) in
        [(10.0, 0.0, 2.0), (10.0, 0.02, -3.0), (5.0, 0.05, 2.0), (20.0, 0.0, 5.0), (6.0, -0.08, 1.0)]
    {
        let scenario = steady(speed, curvature);
        let track = plan(&scenario, &format!("shift:{asked}"));
        obeys(&scenario.start.now(0), &track).unwrap();
        let logged: Vec<Vec2> =
            scenario.logged(0)[CURRENT..].iter().flatten().map(AgentState::position).collect();
        let path = Polyline::new(&logged).unwrap();
        for (k, state) in track.iter().enumerate().filter(|(k, _)| (50..70).contains(k)) {
            let offset = path.project(state.position()).offset;
            assert!((offset - asked).abs() < 0.2, "{speed} {curvature} {asked}: {offset} at step {}", k + 1);
        }
    }
}

#[test]
fn a_change_of_gear_is_not_driven_over() {
    let speeds: Vec<f64> = (0..FRAMES).map(|k| if k < 50 { 3.0 } else { -2.0 }).collect();
    let scenario = alone(drive(&speeds, &[0.05; FRAMES], &[]), Vec::new());
    let cusp = scenario.logged(0)[49].unwrap().position();
    let track = plan(&scenario, "retime:2");
    obeys(&scenario.start.now(0), &track).unwrap();
    // The log stops abruptly there; a real vehicle stops before.
    let short = (cusp - track[FUTURE - 1].position()).dot(&direction(track[FUTURE - 1].heading));
    assert!((-0.5..4.0).contains(&short), "{short} m short of the change of gear");
    let back: Vec<f64> = vec![-2.0; FRAMES];
    let scenario = alone(drive(&back, &[0.1; FRAMES], &[]), Vec::new());
    let track = plan(&scenario, "retime:1");
    obeys(&scenario.start.now(0), &track).unwrap();
    let logged = scenario.logged(0)[90].unwrap().position();
    assert!((track[FUTURE - 1].position() - logged).norm() < 0.5);
}

/// Generates speeds and curvatures that a driver could have driven: bounded changes, halts included.
fn any_drive() -> impl Strategy<Value = (Vec<f64>, Vec<f64>, Vec<(f64, f64)>)> {
    let changes = prop::collection::vec((-3.5_f64..3.0, -0.16_f64..0.16), 10);
    let noise = prop::collection::vec((-0.02_f64..0.02, -0.006_f64..0.006), FRAMES);
    (0.0_f64..22.0, changes, noise).prop_map(|(first, changes, noise)| {
        let (mut speed, mut bend) = (first, 0.0_f64);
        let (mut speeds, mut bends) = (Vec::new(), Vec::new());
        for k in 0..FRAMES {
            let (change, wanted) = changes[k / 10 % changes.len()];
            speed = (speed + change * DT).max(0.0);
            let most = 0.2_f64.min(3.0 / (speed * speed).max(0.1));
            bend += (wanted.clamp(-most, most) - bend).clamp(-0.02, 0.02);
            bend = bend.clamp(-most, most);
            speeds.push(speed);
            bends.push(bend);
        }
        (speeds, bends, noise)
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    #[test]
    fn every_script_obeys_the_limits((speeds, bends, noise) in any_drive()) {
        let scenario = alone(drive(&speeds, &bends, &noise), Vec::new());
        let now = scenario.start.now(0);
        for script in [
            "constant-velocity",
            "brake:0.5",
            "brake:4",
            "brake:6",
            "retime:0.5",
            "retime:1",
            "retime:1.6",
            "retime:3",
            "shift:2",
            "shift:-5",
        ] {
            let track = plan(&scenario, script);
            prop_assert_eq!(track.len(), FUTURE);
            if let Err(what) = obeys(&now, &track) {
                prop_assert!(false, "{}: {}", script, what);
            }
        }
    }

    #[test]
    fn retime_by_one_stays_with_the_log((speeds, bends, noise) in any_drive()) {
        let scenario = alone(drive(&speeds, &bends, &noise), Vec::new());
        let track = plan(&scenario, "retime:1");
        for (k, (state, logged)) in track.iter().zip(&scenario.log_future.tracks[0]).enumerate() {
            let away = (state.position() - logged.unwrap().position()).norm();
            prop_assert!(away < 0.5, "{away} m away at step {}: {state:?} {logged:?}", k + 1);
        }
    }
}

#[test]
fn errors_quote_long_numbers_briefly() {
    let error = format!("brake:1{}", "0".repeat(300)).parse::<Script>().unwrap_err().to_string();
    assert!(error.starts_with("`brake:1e300` is not a scripted AV"), "{error}");
    let error = "brake".parse::<Script>().unwrap_err().to_string();
    assert!(error.starts_with("`brake` is not"), "{error}");
}
