//! The review page: its data, and the scenes that it draws.

use std::path::PathBuf;

use reactsim::curation::ScenarioRecord;
use reactsim::formats;
use reactsim::report::page::write_review;
use reactsim::web::sketch;
use serde_json::{Value, json};

use super::hand;
use crate::page::data_of;
use crate::small_scenarios;

/// Returns scenarios that can be drawn, with hand-made candidates.
pub(super) fn records(count: usize) -> Vec<ScenarioRecord> {
    let record = |i: usize| {
        let drawn = small_scenarios::scenario(i);
        ScenarioRecord { scene: Some(sketch(&drawn)), ..hand::scenario(&drawn.id, 6) }
    };
    (0..count).map(record).collect()
}

/// Writes a file of such scenarios to a new folder.
pub(super) fn file(count: usize) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("set.parquet");
    hand::write(&path, &records(count));
    (folder, path)
}

#[test]
fn the_page_has_the_scenarios_that_are_asked_for() {
    let (_folder, path) = file(5);
    let page = |from: usize, count: usize| {
        let mut out = Vec::new();
        write_review(&path, from, count, &mut out).map(|total| (total, String::from_utf8(out).unwrap()))
    };
    let (total, text) = page(2, 3).unwrap();
    assert_eq!((total, page(2, 3).unwrap().1 == text), (5, true), "the same file gives the same bytes");
    let data = data_of(&text);
    assert_eq!((&data["file"], &data["from"], &data["total"]), (&json!("set.parquet"), &json!(2), &json!(5)));
    let all = records(5);
    let ids: Vec<&str> =
        data["scenarios"].as_array().unwrap().iter().map(|s| s["id"].as_str().unwrap()).collect();
    assert_eq!(ids, all[1..4].iter().map(|r| r.scenario_id.as_str()).collect::<Vec<_>>());
    assert_eq!(data["scenarios"][0]["candidates"][2], json!([2, "directional", "pressure", false]));
    assert_eq!(text.matches("<script type=\"application/gzip\"").count(), 3);
    assert_eq!(page(5, 100).unwrap().1.matches("id=\"scene-").count(), 1);
    let error = page(6, 1).unwrap_err().to_string();
    assert!(
        error.ends_with("has 5 scenarios with candidates: there is none to review from number 6 on"),
        "{error}"
    );
}

#[test]
fn a_scene_is_the_same_every_time_and_gives_the_tracks_back() {
    let scenario = small_scenarios::scenario(3);
    let text = sketch(&scenario);
    assert_eq!(text, sketch(&small_scenarios::scenario(3)));
    let value: Value = serde_json::from_str(&text).unwrap();
    let agents = value["agents"].as_array().unwrap();
    assert_eq!(agents.len(), scenario.start.agents.len());
    for (i, agent) in agents.iter().enumerate() {
        assert_eq!(agent["id"], scenario.start.agents[i].id.as_str());
        for span in agent["t"].as_array().unwrap() {
            let numbers: Vec<i64> = span.as_array().unwrap().iter().map(|v| v.as_i64().unwrap()).collect();
            let mut state = [0; 4];
            for (k, step) in numbers[1..].chunks(4).enumerate() {
                state.iter_mut().zip(step).for_each(|(sum, d)| *sum += d);
                let logged = scenario.logged(i)[numbers[0] as usize + k].unwrap();
                let expected = [logged.x, logged.y, logged.heading * 10.0, logged.speed()];
                assert_eq!(state, expected.map(|v| (v * 100.0).round() as i64));
            }
        }
    }
    // The road of 600 m is cut to the surroundings of the AV, and straight lines are two points.
    let edge = value["edges"][0][1].as_array().unwrap();
    assert_eq!(edge.len(), 4);
    assert!(edge[2].as_i64().unwrap() < 60_000);
}

#[test]
fn scenes_of_real_logs_are_small() {
    let Some(folder) = crate::shared("data/womd/train") else { return };
    for scenario in formats::open(&folder).unwrap().filter_map(Result::ok).take(20) {
        let text = sketch(&scenario);
        assert!(text.len() < 150_000, "{}: {} bytes", scenario.id, text.len());
        assert!(serde_json::from_str::<Value>(&text).is_ok());
    }
}
