//! Recordings whose ground, clock, velocities or links are unusual, as the user of the program sees them.

use std::path::Path;

use reactsim::scene::FRAMES;
use serde_json::{Value, json};

use crate::program::{refused, said, text};

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
    let (summary, notes) = said(&[&["run", text(&path)], arguments, &["--format", "json"]].concat(), 0);
    (serde_json::from_str(&summary).unwrap(), notes, said(&["inspect", text(&path)], 0).0)
}

fn mean(summary: &Value, simulator: &str, metric: &str) -> Option<f64> {
    summary["simulators"][simulator]["metrics"][metric]["mean"].as_f64()
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

/// Scenarios with such properties are repaired as the tests of the crate `scene` say; here is what users
/// read.
#[test]
fn unusual_velocities_clocks_and_links_are_reported() {
    let scenario = |change: &dyn Fn(&mut Value)| {
        let agents =
            vec![driver("av", 0.0, 0.0, 10.0), driver("b", 30.0, 0.0, 10.0), driver("c", 20.0, 3.5, 10.0)];
        let mut scenario = file(agents, road());
        change(&mut scenario);
        scenario
    };
    let with_speed = |speed: f64| {
        scenario(&|scenario| {
            for agent in scenario["agents"].as_array_mut().unwrap() {
                agent["track"]["vx"] = vec![speed; FRAMES].into();
                agent["track"]["vy"] = vec![0.0; FRAMES].into();
            }
        })
    };
    let with_clock = |late: f64| {
        let times: Vec<f64> =
            (0..FRAMES).map(|f| 0.1 * f as f64 + if f >= 40 { late } else { 0.0 }).collect();
        scenario(&|scenario| scenario["timestamps"] = times.clone().into())
    };
    let appearing = scenario(&|scenario| {
        for list in ["x", "y", "heading"] {
            scenario["agents"][1]["track"][list].as_array_mut().unwrap()[..10].fill(Value::Null);
        }
    });
    let far_link = scenario(&|scenario| {
        let lanes = &mut scenario["map"]["lanes"];
        lanes[0]["points"] = json!([[-200, 0], [60, 0]]);
        lanes[0]["successors"] = json!(["aside"]);
        lanes.as_array_mut().unwrap().push(json!({ "id": "aside", "points": [[60, 200], [300, 200]] }));
    });
    let contradict = "3 agents have velocities that contradict their positions (first: `made`, replaced by \
                      differences of positions: ";
    let km_h = "they look like velocities, in km/h, 3.60 times as large as differences of positions";
    for (scenario, note, part) in [
        (with_speed(10.0), String::new(), ""),
        (appearing, "1 agent has an unknown velocity at the current frame".to_owned(), ""),
        (with_speed(36.0), format!("{contradict}{km_h})"), km_h),
        (with_speed(0.0), format!("{contradict}all velocities are zero)"), "all velocities are zero"),
        (
            with_clock(0.2),
            "1 time step is not 0.1 s (first: `made`, 0.30 s before frame 40)".to_owned(),
            "1 time step is not 0.1 s: 0.30 s before frame 40",
        ),
        (far_link, String::new(), "1 links between lanes that do not meet"),
    ] {
        let (summary, said, seen) = run(&scenario, &["--av", "log", "--models", "constant-velocity,idm"]);
        let expected = if note.is_empty() { note } else { format!("note: 1 scenario: {note}\n") };
        assert_eq!(said, expected);
        assert!(seen.contains(part), "{part}: {seen}");
        assert_eq!(mean(&summary, "idm", "offroad"), Some(0.0), "{part}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("made.json");
    write(&path, &with_clock(2.0));
    let error = refused(&["inspect", text(&path)]);
    assert!(error.contains("timestamps[40] is 2.100 s after the frame before"), "{error}");
}
