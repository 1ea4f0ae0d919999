//! Logs of more than 8 s with agents that enter, from the file to the page.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::program::{json_of, lines_of, refused, said, text};

/// Files of a run that repeat.
const REPEATED: [&str; 4] = ["provenance.json", "rows.jsonl", "summary.json", "rollouts.parquet"];

#[test]
fn a_run_with_agents_that_enter_can_be_repeated_and_merged() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name);
    let (logs, first) = (path("logs.parquet"), path("first"));
    said(&["generate", "--preset=sensed", "--count=2", "--future=12s", "--out", text(&logs)], 0);
    let options = ["--models=log-replay,idm,constant-velocity", "--av=brake:2", "--entering=log"];
    let run = |more: &[&str]| said(&[&["run", text(&logs)], &options[..], more].concat(), 0);
    run(&["--keep-rollouts", "--out", text(&first)]);
    let settings = &json_of(&first.join("provenance.json"))["settings"];
    assert_eq!(settings["entering"], "log");
    assert!(fs::read_to_string(first.join("spec.toml")).unwrap().contains("entering = \"log\""));

    let rows: Vec<Value> = lines_of(&first.join("rows.jsonl"));
    let entered = |row: &Value| row["outcomes"]["agents-entered"].as_u64().unwrap_or(0);
    assert!(rows.iter().map(entered).sum::<u64>() > 0, "no agent enters");
    // What enters is the same under every simulator, but for places that are taken.
    assert!(rows.iter().all(|row| row["length"]["steps"] == 120));

    // The specification of the folder, partitions, another number of threads.
    let again = path("again");
    said(&["run", text(&first.join("spec.toml")), "--out", text(&again), "--jobs=1"], 0);
    let parts = ["1/2", "2/2"].map(|part| {
        let folder = path(&part.replace('/', "-"));
        run(&["--keep-rollouts", "--partition", part, "--out", text(&folder)]);
        text(&folder).to_owned()
    });
    let merged = path("merged");
    said(&["merge", &parts[0], &parts[1], "--out", text(&merged)], 0);
    for (folder, name) in REPEATED.iter().flat_map(|name| [(&again, name), (&merged, name)]) {
        let same = fs::read(folder.join(name)).unwrap() == fs::read(first.join(name)).unwrap();
        assert!(same, "{}: {name}", folder.display());
    }

    // Scores of the kept rollouts, which agents entered and left.
    let scored = path("scored");
    let rollouts = first.join("rollouts.parquet");
    said(&["score", text(&rollouts), "--scenarios", text(&logs), "--out", text(&scored)], 0);
    let values = |rows: Vec<Value>| -> BTreeMap<String, Value> {
        let key = |row: &Value| format!("{} {} {}", row["scenario"], row["simulator"], row["rollout"]);
        rows.into_iter().map(|mut row| (key(&row), row["metrics"].take())).collect()
    };
    assert_eq!(values(lines_of(&scored.join("rows.jsonl"))), values(rows));
    // Elsewhere, nothing says that agents entered.
    let copy = path("copy.parquet");
    fs::copy(&rollouts, &copy).unwrap();
    let (_, told) = said(&["score", text(&copy), "--scenarios", text(&logs), "--out", text(&path("no"))], 2);
    assert!(told.contains("appears after the current frame: leave it out"), "{told}");

    let page = path("page.html");
    said(&["report", text(&first), "--format=html", "--out", text(&page)], 0);
    let off = path("off");
    said(&["run", text(&logs), options[0], options[1], "--out", text(&off)], 0);
    let refusal = refused(&["compare", text(&first), text(&off)]);
    assert!(refusal.contains("entering"), "{refusal}");

    // Tables say why their rows cannot be compared.
    let short = path("short");
    said(&["run", "--limit=1", options[0], options[1], "--out", text(&short)], 0);
    let reported = |other: &Path| said(&["report", text(&first), text(other), "--format=markdown"], 0).0;
    let cannot = "Not all runs can be compared with each other: they differ in";
    let (same, coming, length) = (reported(&again), reported(&off), reported(&short));
    assert!(!same.contains(cannot), "{same}");
    assert!(coming.contains(&format!("{cannot} entering.")), "{coming}");
    assert!(coming.contains("AV brake:2, entering log, replan"), "{coming}");
    let expected = format!("{cannot} length (12 s (120 steps), 8 s (80 steps)), entering.");
    assert!(length.contains(&expected), "{length}");
}

#[test]
fn planners_on_logs_meet_agents_that_enter() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name);
    let logs = path("logs.parquet");
    said(&["generate", "--preset=sensed", "--count=1", "--seed=5", "--future=10s", "--out", text(&logs)], 0);
    let rows = |name: &str, more: &[&str]| {
        let out = path(name);
        said(&[&["run", text(&logs), "--models=idm", "--out", text(&out)], more].concat(), 0);
        lines_of(&out.join("rows.jsonl"))
    };
    let on = rows("on", &["--av=planner:idm"]);
    assert!(on[0]["outcomes"]["agents-entered"].as_u64() > Some(0), "{}", on[0]);
    for (name, more) in
        [("off", ["--av=planner:idm", "--entering=off"]), ("script", ["--av=brake:2", "--replan=2hz"])]
    {
        assert!(rows(name, &more)[0]["outcomes"].get("agents-entered").is_none(), "{name}");
    }
}
