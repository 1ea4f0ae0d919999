//! Input that once hung the program, ended it, or gave a number.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::program::reactsim;

/// Returns a rollout document with one scenario: an AV and another vehicle, one behind the other, between two
/// road edges.
fn document() -> Value {
    let steady = |x: f64| (0..91).map(|f| x + 0.5 * f64::from(f)).collect::<Vec<_>>();
    let agent = |id: &str, x: f64| {
        json!({
            "id": id, "type": "vehicle", "length": 4.5, "width": 2.0, "x": steady(x), "y": vec![0.0; 91],
            "heading": vec![0.0; 91], "vx": null, "vy": null, "valid": vec![true; 91]
        })
    };
    let area =
        json!([{ "exterior": [[-50.0, -6.0], [150.0, -6.0], [150.0, 6.0], [-50.0, 6.0]], "holes": [] }]);
    let edges = json!([[[-50.0, -6.0], [150.0, -6.0]], [[150.0, 6.0], [-50.0, 6.0]]]);
    let scenario = json!({
        "id": "pair", "current_index": 10, "num_future": 80, "av_index": 0,
        "map": { "drivable_area": area, "road_edges": edges },
        "agents": [agent("av", 12.0), agent("follower", 0.0)]
    });
    json!({ "format": "reactsim-rollouts-v1", "dt": 0.1, "scenarios": [scenario] })
}

/// Returns the exit code of `score` for a document, and its messages.
fn score(document: &Value) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("document.json");
    fs::write(&path, document.to_string()).unwrap();
    let before = Instant::now();
    let output = reactsim(&["score", path.to_str().unwrap()]);
    assert!(before.elapsed() < Duration::from_secs(20), "it took {:?}", before.elapsed());
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn documents_are_scored() {
    let (code, error) = score(&document());
    assert_eq!(code, Some(0), "{error}");
}

#[test]
fn far_and_huge_values_are_refused_by_place() {
    for (name, value) in [("y", 1e10), ("x", -1e300), ("y", 1e8), ("heading", 1e9), ("vx", 1e5)] {
        let mut changed = document();
        let agent = &mut changed["scenarios"][0]["agents"][1];
        if name == "vx" {
            agent["vx"] = json!(vec![5.0; 91]);
            agent["vy"] = json!(vec![0.0; 91]);
        }
        for f in 21..91 {
            agent[name][f] = json!(value);
        }
        let (code, error) = score(&changed);
        assert_eq!(code, Some(2), "{error}");
        assert!(error.contains(&format!("`follower`).{name}[21]")) && error.len() < 400, "{error}");
    }
    let mut changed = document();
    changed["scenarios"][0]["agents"][1]["length"] = json!(1e300);
    assert!(score(&changed).1.contains("less than 1000 m"));
    let mut changed = document();
    changed["scenarios"][0]["map"]["road_edges"][0][1] = json!([1e12, 0.0]);
    assert!(score(&changed).1.contains("within 100 km of the AV"));
}

#[test]
fn what_a_document_lacks_or_repeats_is_said() {
    let mut empty = document();
    empty["scenarios"] = json!([]);
    let mut twice = document();
    let first = twice["scenarios"][0].clone();
    twice["scenarios"].as_array_mut().unwrap().push(first);
    let mut misspelt = document();
    misspelt["option"] = json!({ "fault_order": "nuplan" });
    let mut crowded = document();
    let agents = crowded["scenarios"][0]["agents"].as_array_mut().unwrap();
    for i in 0..2500 {
        let mut agent = agents[1].clone();
        agent["id"] = json!(format!("copy-{i}"));
        agents.push(agent);
    }
    for (document, part) in [
        (empty, "at least one scenario"),
        (twice, "an id that no other scenario has"),
        (misspelt, "unknown field `option`"),
        (crowded, "at most 2000 agents"),
        (json!([]), "expected an object"),
    ] {
        let (code, error) = score(&document);
        assert_eq!(code, Some(2), "{error}");
        assert!(error.contains(part) && !error.contains("struct"), "{part}: {error}");
    }
}

#[test]
#[cfg(unix)]
fn pipes_and_devices_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("scenario.json");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [pipe.as_path(), Path::new("/dev/zero")] {
        let path = path.to_str().unwrap();
        for arguments in
            [vec!["score", path], vec!["run", path], vec!["inspect", path], vec!["run", "--deviations", path]]
        {
            let output = reactsim(&arguments);
            let error = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(2), "{arguments:?}: {error}");
            assert!(error.contains("a pipe or a device"), "{arguments:?}: {error}");
        }
    }
    // In a folder, the pipe is passed over.
    fs::copy(
        concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini/crossing.json"),
        folder.path().join("b.json"),
    )
    .unwrap();
    let output = reactsim(&["run", folder.path().to_str().unwrap(), "--models", "stop"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn negative_numbers_are_values() {
    let output = reactsim(&["run", "--limit", "-1"]);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("invalid value '-1' for '--limit"), "{error}");
}
