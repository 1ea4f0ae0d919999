//! Recordings whose ground, clock, velocities or links are unusual, as the user of the program sees them.

use std::path::Path;
use std::process::Output;

use reactsim::scene::FRAMES;
use serde_json::{Value, json};

use crate::program::{ended, reactsim, stderr, stdout, text};

/// Returns an agent at these positions, with heading 0 and without velocities.
fn agent(id: &str, at: impl Fn(usize) -> (f64, f64)) -> Value {
    let all: Vec<(f64, f64)> = (0..FRAMES).map(at).collect();
    let x: Vec<f64> = all.iter().map(|p| p.0).collect();
    let y: Vec<f64> = all.iter().map(|p| p.1).collect();
    let track = json!({ "x": x, "y": y, "heading": vec![0.0; FRAMES] });
    json!({ "id": id, "length": 4.5, "width": 2.0, "track": track })
}

/// Returns an agent with a constant speed along the x axis that is at a position at the current frame.
fn driver(id: &str, x: f64, y: f64, speed: f64) -> Value {
    agent(id, |f| (x + speed * 0.1 * (f as f64 - 10.0), y))
}

/// Returns a road of two lanes along the x axis, 7 m wide, whose edges have the drivable side on their left.
fn road() -> Value {
    let lane = |id: &str, y: f64| json!({ "id": id, "points": [[-200, y], [300, y]], "speed_limit": 14.0 });
    json!({
        "lanes": [lane("right", 0.0), lane("left", 3.5)],
        "road_edges": [
            { "points": [[-200, -1.75], [300, -1.75]] },
            { "points": [[300, 5.25], [-200, 5.25]] }
        ]
    })
}

/// Returns the content of a scenario file, without its format.
fn file(agents: Vec<Value>, map: Value) -> Value {
    json!({
        "id": "made", "intent": "A recording with an unusual property.",
        "agents": agents, "map": map
    })
}

/// Writes a scenario file. The format comes first, since files are recognised by their beginning.
fn write(path: &Path, scenario: &Value) {
    let text = scenario.to_string();
    std::fs::write(path, format!("{{\"format\": \"reactsim-scenario-v1\", {}", &text[1..])).unwrap();
}

/// Writes a scenario and returns the output of a run and of `inspect`.
fn run(scenario: &Value, arguments: &[&str]) -> (Value, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("made.json");
    write(&path, scenario);
    let ran = program(&[&["run", text(&path)], arguments, &["--format", "json"]].concat());
    let seen = program(&["inspect", text(&path)]);
    let summary: Value = serde_json::from_slice(&ran.stdout).unwrap();
    (summary, stderr(&ran), stdout(&seen))
}

fn program(arguments: &[&str]) -> Output {
    let output = ended(arguments, 0);
    output
}

fn mean(summary: &Value, simulator: &str, metric: &str) -> Option<f64> {
    summary["simulators"][simulator]["metrics"][metric]["mean"].as_f64()
}

#[test]
fn a_car_that_turns_into_a_driveway_stays_on_the_road() {
    let av = || driver("av", 0.0, 3.5, 10.0);
    // Leaves the road to the right, by 8 m within 4 s.
    let turning = || agent("turning", |f| (0.5 * f as f64, -8.0 * (f as f64 / 40.0 - 0.5).clamp(0.0, 1.0)));
    let mut map = road();
    let offroad = |map: &Value| {
        let (summary, ..) =
            run(&file(vec![av(), turning()], map.clone()), &["--av", "log", "--models", "log-replay"]);
        mean(&summary, "log-replay", "offroad").unwrap()
    };
    assert!(offroad(&map) > 0.2);
    map["driveways"] = json!([[[0, -1.5], [60, -1.5], [60, -12], [0, -12]]]);
    assert_eq!(offroad(&map), 0.0);
}

#[test]
fn edges_against_the_convention_are_reported() {
    let mut map = road();
    for edge in map["road_edges"].as_array_mut().unwrap() {
        edge["points"].as_array_mut().unwrap().reverse();
    }
    let agents =
        vec![driver("av", 0.0, 0.0, 10.0), driver("b", 30.0, 0.0, 10.0), driver("c", 20.0, 3.5, 9.0)];
    let (summary, said, seen) = run(&file(agents, map), &["--av", "brake:4", "--models", "stop"]);
    assert_eq!(mean(&summary, "stop", "offroad"), None);
    let reversed = "most vehicles on lanes start off the road";
    for part in [reversed, "the AV starts off the road", "2 moving vehicles start off the road"] {
        assert!(said.contains(&format!("note: 1 scenario: {part}")), "{part}: {said}");
        assert!(seen.lines().any(|line| line.starts_with("note ") && line.contains(part)), "{part}: {seen}");
    }
    assert_eq!(summary["provenance"]["notes"]["vehicles-off-road"], json!({ "scenarios": 1, "count": 2 }));
    let agents = vec![driver("av", 0.0, 0.0, 10.0), driver("b", 30.0, 0.0, 10.0)];
    let (summary, said, _) = run(&file(agents, road()), &["--av", "brake:4", "--models", "stop"]);
    assert_eq!((mean(&summary, "stop", "offroad"), said.as_str()), (Some(0.0), ""));
    assert_eq!(summary["provenance"]["notes"], Value::Null);
}

#[test]
fn unknown_velocities_are_those_of_the_positions() {
    // Steps of exactly one metre, so that the estimates are exact.
    let agents =
        || vec![driver("av", 0.0, 0.0, 10.0), driver("b", 30.0, 0.0, 10.0), driver("c", 20.0, 3.5, 10.0)];
    let mut known = agents();
    for agent in &mut known {
        agent["track"]["vx"] = vec![10.0; FRAMES].into();
        agent["track"]["vy"] = vec![0.0; FRAMES].into();
    }
    let models = ["--av", "log", "--models", "constant-velocity,stop,idm"];
    let [(without, said, _), (with, ..)] =
        [agents(), known].map(|agents| run(&file(agents, road()), &models));
    assert_eq!(said, "");
    assert!(mean(&without, "constant-velocity", "ade").unwrap() < 1e-9);
    for id in ["stop", "idm"] {
        let [a, b] = [&without, &with].map(|summary| mean(summary, id, "ade").unwrap());
        assert!(a > 0.1 && (a - b).abs() < 1e-6, "{id}: {a} and {b}");
    }
    // An agent that appears now has no velocity, which is noted.
    let mut appearing = driver("new", 60.0, 0.0, 10.0);
    for list in ["x", "y", "heading"] {
        appearing["track"][list].as_array_mut().unwrap()[..10].fill(Value::Null);
    }
    let (_, said, _) = run(&file(vec![driver("av", 0.0, 0.0, 10.0), appearing], road()), &models);
    assert_eq!(said, "note: 1 scenario: 1 agent has an unknown velocity at the current frame\n");
}

#[test]
fn velocities_that_contradict_positions_are_replaced_and_noted() {
    let stated = |speed: f64| {
        let mut agents =
            vec![driver("av", 0.0, 0.0, 10.0), driver("b", 30.0, 0.0, 10.0), driver("c", 20.0, 3.5, 10.0)];
        for agent in &mut agents {
            agent["track"]["vx"] = vec![speed; FRAMES].into();
            agent["track"]["vy"] = vec![0.0; FRAMES].into();
        }
        run(&file(agents, road()), &["--av", "log", "--models", "constant-velocity,idm"])
    };
    let (right, said, _) = stated(10.0);
    assert_eq!(said, "");
    let km_h = "they look like velocities, in km/h, 3.60 times as large as differences of positions";
    for (speed, likely) in [(36.0, km_h), (0.0, "all velocities are zero")] {
        let (summary, said, seen) = stated(speed);
        assert!(mean(&summary, "constant-velocity", "ade").unwrap() < 1e-9);
        let [a, b] = [&right, &summary].map(|summary| mean(summary, "idm", "ade").unwrap());
        assert!((a - b).abs() < 1e-6, "{a} and {b}");
        let note = format!(
            "3 agents have velocities that contradict their positions (first: `made`, replaced by differences of \
             positions: {likely})"
        );
        assert_eq!(said, format!("note: 1 scenario: {note}\n"));
        assert!(seen.contains(&format!("replaced by differences of positions: {likely}")), "{seen}");
    }
}

#[test]
fn irregular_clocks_are_reported_with_their_frame() {
    let mut scenario = file(vec![driver("av", 0.0, 0.0, 10.0), driver("b", 30.0, 0.0, 10.0)], road());
    let clock = |late: f64| -> Value {
        (0..FRAMES).map(|f| 0.1 * f as f64 + if f >= 40 { late } else { 0.0 }).collect::<Vec<_>>().into()
    };
    scenario["timestamps"] = clock(0.2);
    let (_, said, seen) = run(&scenario, &["--av", "log", "--models", "constant-velocity"]);
    assert_eq!(said, "note: 1 scenario: 1 time step is not 0.1 s (first: `made`, 0.30 s before frame 40)\n");
    assert!(seen.contains("1 time step is not 0.1 s: 0.30 s before frame 40"), "{seen}");
    scenario["timestamps"] = clock(2.0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("made.json");
    write(&path, &scenario);
    let refused = reactsim(&["inspect", text(&path)]);
    let said = stderr(&refused);
    assert!(said.contains("timestamps[40] is 2.100 s after the frame before"), "{said}");
}

#[test]
fn links_to_lanes_far_away_are_not_driven() {
    let mut map = road();
    map["lanes"][0]["points"] = json!([[-200, 0], [60, 0]]);
    map["lanes"][0]["successors"] = json!(["aside"]);
    map["lanes"].as_array_mut().unwrap().push(json!({ "id": "aside", "points": [[60, 200], [300, 200]] }));
    let agents = vec![driver("av", 0.0, 3.5, 10.0), driver("b", 20.0, 0.0, 10.0)];
    let (summary, _, seen) = run(&file(agents, map), &["--av", "log", "--models", "idm"]);
    assert_eq!(mean(&summary, "idm", "offroad"), Some(0.0));
    assert!(seen.contains("1 links between lanes that do not meet"), "{seen}");
}

#[test]
fn written_scenarios_read_back_with_estimates_and_without_links() {
    let folder = tempfile::tempdir().unwrap();
    let (path, written) = (folder.path().join("made.json"), folder.path().join("made.parquet"));
    let mut map = road();
    map["lanes"][0]["successors"] = json!(["aside"]);
    map["lanes"].as_array_mut().unwrap().push(json!({ "id": "aside", "points": [[60, 200], [300, 200]] }));
    let scenario = file(vec![driver("av", 0.0, 3.5, 10.0), driver("b", 20.0, 0.0, 10.0)], map);
    write(&path, &scenario);
    program(&["convert", text(&path), "--out", text(&written)]);
    let [made, back] = [&path, &written].map(|path| program(&["inspect", text(path)]).stdout);
    assert_eq!(String::from_utf8(made).unwrap(), String::from_utf8(back).unwrap());
}
