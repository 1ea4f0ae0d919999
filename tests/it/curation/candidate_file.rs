//! Candidates of other planners: `curate --source file:PATH`.

use std::fs;
use std::path::Path;

use reactsim::curation::{ScenarioRecord, store};
use reactsim::scene::{AgentState, Scenario};
use serde_json::{Value, json};

use super::cli::closing;
use crate::program::{BENCH, said, text};
use crate::small_scenarios::write as write_scenarios;

fn curate(scenarios: &str, out: &Path, more: &[&str], code: i32) -> String {
    said(&[&["curate", scenarios, "--out", text(out), "--quiet"], more].concat(), code).1
}

fn records(path: &Path) -> Vec<ScenarioRecord> {
    store::read(path).unwrap().map(|record| record.unwrap()).collect()
}

#[test]
fn candidates_are_judged_as_if_the_rules_had_proposed_them() {
    let home = tempfile::tempdir().unwrap();
    let (own, again) = (home.path().join("own.parquet"), home.path().join("again.parquet"));
    curate(BENCH, &own, &["--limit", "5"], 0);
    let source = format!("file:{}", text(&own));
    curate(BENCH, &again, &["--limit", "5", "--source", &source], 0);
    let (own, again) = (records(&own), records(&again));
    assert!(own.iter().any(|record| record.chosen().is_some()), "nothing was chosen");
    assert_eq!(own.len(), again.len());
    for (a, b) in own.iter().zip(&again) {
        assert_eq!((&a.scenario_id, a.candidates.len()), (&b.scenario_id, b.candidates.len()));
        for (i, (a, b)) in a.candidates.iter().zip(&b.candidates).enumerate() {
            let place = (b.candidate.source.as_str(), b.candidate.number as usize);
            assert_eq!(place, ("file", i));
            assert_eq!(a.candidate.track, b.candidate.track);
            assert_eq!(a.candidate.maneuver, b.candidate.maneuver);
            assert_eq!((&a.figures, &a.rejected_by, a.chosen), (&b.figures, &b.rejected_by, b.chosen));
            assert_eq!(a.certificate, b.certificate);
        }
    }
    let settings = store::read(home.path().join("again.parquet")).unwrap().provenance().settings.clone();
    assert_eq!(settings["source"], "file:own.parquet");
    assert_eq!(settings["source.blake3"].len(), 64);
}

#[test]
fn samples_of_a_network_are_judged_like_any_candidates() {
    let home = tempfile::tempdir().unwrap();
    let (weights, out) = (home.path().join("w.safetensors"), home.path().join("c.parquet"));
    fs::write(&weights, crate::diffusion_planner::untrained()).unwrap();
    let source = format!("diffusion:{}", text(&weights));
    curate(BENCH, &out, &["--limit", "3", "--source", &source, "--candidates", "5"], 0);
    let found = records(&out);
    assert!(!found.is_empty());
    for record in &found {
        assert!((1..=5).contains(&record.candidates.len()));
        for candidate in &record.candidates {
            assert_eq!(candidate.candidate.source, "diffusion");
            assert!(!candidate.figures.is_empty());
        }
    }
    let settings = store::read(&out).unwrap().provenance().settings.clone();
    assert_eq!(
        (&settings["source"][..], &settings["source.temperature"][..]),
        ("diffusion:w.safetensors", "1.5")
    );
    assert_eq!(settings["source.sha256"].len(), 64);
}

/// Returns a trajectory that continues from a state at a speed, in world coordinates.
fn straight(scenario: &Scenario, speed: f64) -> Value {
    let AgentState { x, y, heading, .. } = scenario.start.now(0);
    let along = |k: u32| 0.1 * f64::from(k) * speed;
    let column = |start: f64, rate: f64| (1..=80).map(|k| start + rate * along(k)).collect::<Vec<f64>>();
    json!({
        "scenario_id": scenario.id,
        "maneuver": format!("{speed} m/s"),
        "x": column(x + scenario.origin.x, heading.cos()),
        "y": column(y + scenario.origin.y, heading.sin()),
        "heading": vec![heading; 80],
    })
}

#[test]
fn what_can_not_be_meant_is_refused_and_named() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name);
    let all: Vec<Scenario> = (0..3).map(closing).collect();
    write_scenarios(&path("s.parquet"), &all);
    let (scenarios, planned, out) = (path("s.parquet"), path("planned.json"), path("out.parquet"));
    let run = |deviations: Value, more: &[&str], code| {
        drop(fs::remove_file(&out));
        let file = json!({ "format": "reactsim-deviations-v1", "frame": "world", "deviations": deviations });
        fs::write(&planned, file.to_string()).unwrap();
        let source = format!("file:{}", text(&planned));
        let limits = ["--source", &source, "--min-vehicles", "1", "--max-ttc", "100"];
        curate(text(&scenarios), &out, &[&limits[..], more].concat(), code).replace(text(home.path()), "HOME")
    };
    let speeds = |i: usize| [4.0, 7.0].map(|speed| straight(&all[i], speed));
    let two = [speeds(0), speeds(1)].concat();

    // All candidates of a scenario, in the order of the file; one that repeats another counts as a
    // repetition.
    run(json!(two), &[], 0);
    let kept = records(&out);
    assert!(!kept.is_empty());
    for record in &kept {
        let maneuvers: Vec<&str> = record.candidates.iter().map(|c| c.candidate.maneuver.as_str()).collect();
        assert_eq!(maneuvers, ["4 m/s", "7 m/s"]);
        let from = record.candidates[0].candidate.track[0];
        let to = record.candidates[0].candidate.track[80];
        assert!(((to.x - from.x).hypot(to.y - from.y) - 32.0).abs() < 1e-6, "coordinates are of the world");
    }
    let said = run(json!(two), &["--candidates", "1"], 0);
    assert!(records(&out).iter().all(|record| record.candidates.len() == 1), "{said}");
    let provenance = store::read(&out).unwrap().provenance().clone();
    assert_eq!(provenance.funnel.unproposed["the file has no candidate for the scenario"], 1);

    // Errors of the file end the command, and no output is left.
    let with = |change: &dyn Fn(&mut Value)| {
        let mut changed = two.clone();
        change(&mut changed[1]);
        json!(changed)
    };
    for (deviations, expected) in [
        (json!([]), "the file is empty, expected at least one trajectory"),
        (with(&|d| d["speed"] = json!(1)), "unknown field `speed`"),
    ] {
        let said = run(deviations, &[], 2);
        assert!(said.contains("HOME/planned.json") && said.contains(expected), "{said}");
        assert!(!out.exists());
    }
    let many: Vec<Value> = (0..1001).map(|_| straight(&all[0], 4.0)).collect();
    let said = run(json!(many), &[], 2);
    assert!(said.contains("1001 candidates, expected at most 1000"), "{said}");

    // Errors of a scenario are its own.
    for (deviations, expected) in [
        (with(&|d| d["y"][6] = json!(1e9)), "candidate 1 of planned.json: y at step 7 is"),
        (
            with(&|d| ["x", "y", "heading"].into_iter().for_each(|key| d[key] = json!(vec![0.0; 79]))),
            "candidate 1 of planned.json: the number of steps is 79, expected 80, as many as",
        ),
        (with(&|d| d["vx"] = json!(vec![5000.0; 80])), "candidate 1 of planned.json: vx at step 1 is 5000"),
        (
            with(&|d| d["scenario_digest"] = json!("0000")),
            "candidate 1 of planned.json: scenario_digest is 0000",
        ),
    ] {
        let said = run(deviations, &[], 1);
        assert!(said.contains(&format!("scenario `{}`", all[0].id)) && said.contains(expected), "{said}");
        assert!(!said.contains("not among the inputs"), "{said}");
        assert!(records(&out).iter().all(|record| record.scenario_id != all[0].id));
    }

    // Scenarios that nobody asked for.
    let mut other = straight(&all[0], 4.0);
    other["scenario_id"] = json!("elsewhere");
    let said = run(json!([two[0], other]), &[], 0);
    assert!(said.contains("1 scenario not among the inputs, such as `elsewhere`"), "{said}");
    let said = run(json!([other]), &[], 2);
    assert!(said.contains("it has `elsewhere`, they have `road-000`"), "{said}");
    assert!(!out.exists());
}
