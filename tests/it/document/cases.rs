//! The worked cases next to the specification: each is a document with expected numbers.

use std::fs;
use std::path::PathBuf;

use reactsim::evaluation::document::score_document;
use reactsim::formats::document::Document;
use serde_json::Value;

fn folder() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/metric_cases"))
}

fn step<'v>(value: &'v Value, key: &str) -> Option<&'v Value> {
    match value {
        Value::Array(items) => items.get(key.parse::<usize>().ok()?),
        other => other.get(key),
    }
}

/// Returns the value at an `expect` key: of the aggregate, of the counts of scenarios, of an agent or of the
/// first scenario.
fn lookup<'v>(result: &'v Value, path: &str) -> Option<&'v Value> {
    let keys: Vec<&str> = path.split('.').collect();
    let scenario = &result["scenarios"][0];
    let (from, rest) = match keys[0] {
        "aggregate" => (&result["aggregate"], &keys[1..]),
        "valid" => (&result["valid_scenarios"], &keys[1..]),
        "agents" => {
            let agents = scenario["agents"].as_array()?;
            (agents.iter().find(|a| a["id"] == keys[1])?, &keys[2..])
        }
        _ => (scenario, &keys[..]),
    };
    rest.iter().try_fold(from, |value, key| step(value, key))
}

fn agrees(found: &Value, expected: &Value) -> bool {
    match (found, expected) {
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            (a - b).abs() <= 1e-9 * (1.0 + b.abs())
        }
        (Value::Array(a), Value::Array(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| agrees(a, b))
        }
        (Value::Object(a), Value::Object(b)) => {
            b.iter().all(|(key, b)| a.get(key).is_some_and(|a| agrees(a, b)))
        }
        (a, b) => a == b,
    }
}

#[test]
fn worked_cases_come_out_as_written() {
    let Ok(entries) = fs::read_dir(folder()) else {
        return crate::skipped("no worked cases beside the repository");
    };
    let mut paths: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "json"));
    paths.sort();
    let mut wrong = Vec::new();
    for path in &paths {
        let case: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
        let name = case["name"].as_str().unwrap();
        let document = Document::from_json(&case["doc"].to_string()).unwrap();
        let result = score_document(&document).unwrap();
        for (key, expected) in case["expect"].as_object().unwrap() {
            match lookup(&result, key) {
                Some(found) if agrees(found, expected) => {}
                found => wrong.push(format!("{name}: {key} is {found:?}, expected {expected}")),
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(!paths.is_empty());
}
