//! Selected and converted scenarios, and deviations from files.

use std::fs;
use std::process::Output;

use super::{results, stderr, stdout, text};
use crate::program::reactsim;
use crate::small_scenarios::{deviating, deviations, scenario, write};

#[test]
fn deviations_from_a_file_are_those_that_scenarios_carry() {
    let home = tempfile::tempdir().unwrap();
    let (carried, plain) = (home.path().join("carried.parquet"), home.path().join("plain.parquet"));
    write(&carried, (0..3).map(scenario));
    write(&plain, (0..3).map(|i| deviating(i, false)));
    let record = |i: usize| {
        let deviation = scenario(i).deviation.unwrap();
        let each = |of: fn(&reactsim::scene::AgentState) -> f64| -> Vec<f64> {
            deviation.track.iter().map(of).collect()
        };
        serde_json::json!({
            "scenario_id": format!("road-{i:03}"), "category": deviation.category.map(|c| c.name()),
            "x": each(|s| s.x), "y": each(|s| s.y), "heading": each(|s| s.heading)
        })
    };
    let file = home.path().join("deviations.json");
    let put = |records: Vec<serde_json::Value>| {
        let all = serde_json::json!({
            "format": "reactsim-deviations-v1", "frame": "world", "deviations": records
        });
        fs::write(&file, all.to_string()).unwrap();
    };
    let simulators = |output: &Output| {
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        summary["simulators"].clone()
    };
    let common = ["--models", "log-replay,stop", "--format", "json"];
    let wanted = reactsim(&[&["run", text(&carried)], &common[..]].concat());
    assert_eq!(wanted.status.code(), Some(0), "{}", stderr(&wanted));
    put((0..3).map(record).collect());
    let named = format!("file:{}", text(&file));
    for choice in [["--deviations", text(&file)], ["--av", &named]] {
        let output = reactsim(&[&["run", text(&plain)], &common[..], &choice].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert_eq!(simulators(&output), simulators(&wanted));
    }
    // One scenario without a trajectory, one with a trajectory that was made for another version of it.
    let mut foreign = record(1);
    foreign["scenario_digest"] = "0".repeat(64).into();
    put(vec![record(0), foreign]);
    let output = reactsim(&[&["run", text(&plain), "--deviations", text(&file)], &common[..]].concat());
    assert_eq!(output.status.code(), Some(1));
    assert!(
        stderr(&output).contains("`road-001`: the deviated AV was made for a scenario with the digest 000")
    );
    assert!(stderr(&output).contains("1 scenario passed over: no deviated AV in the file of deviations"));
    assert_eq!(simulators(&output)["stop"]["scenarios"], 1);
}

#[test]
fn scenarios_without_a_deviation_in_the_file_are_passed_over() {
    let home = tempfile::tempdir().unwrap();
    let (plain, file) = (home.path().join("plain.parquet"), home.path().join("d.json"));
    write(&plain, (0..4).map(|i| deviating(i, false)));
    let document = deviations(&[0, 2, 7]);
    fs::write(&file, document.to_string()).unwrap();
    let out = home.path().join("run");
    let arguments =
        ["run", text(&plain), "--deviations", text(&file), "--models", "stop", "--out", text(&out)];
    let output = reactsim(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    insta::assert_snapshot!(stderr(&output), @r"
    2 scenarios passed over: no deviated AV in the file of deviations
    warning: 1 deviation not used: for scenarios that are not among those that were read
    ");
    // Scenarios beyond the limit are not read, so their deviations are not used either.
    let limited =
        reactsim(&["run", text(&plain), "--deviations", text(&file), "--models", "stop", "--limit", "1"]);
    assert_eq!(limited.status.code(), Some(0), "{}", stderr(&limited));
    insta::assert_snapshot!(stderr(&limited), @"warning: 2 deviations not used: for scenarios that are not among those that were read");
    assert!(stdout(&output).contains("2 scenarios, 2 passed over, "), "{}", stdout(&output));
    let wanted = results(&out);
    let summary: serde_json::Value = serde_json::from_slice(&wanted[0]).unwrap();
    let counts = |key: &str| summary["provenance"][key].as_u64().unwrap();
    assert_eq!((counts("scenarios"), counts("passed_over"), counts("unused_deviations")), (2, 2, 1));
    // A resumed run counts the same, whatever was written before.
    for rows in [2, 0] {
        let text: String = String::from_utf8(wanted[1].clone()).unwrap();
        let kept: String = text.lines().take(rows).map(|l| format!("{l}\n")).collect();
        fs::write(out.join("rows.jsonl"), kept).unwrap();
        let output = reactsim(&[&arguments[..], &["--resume"]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        assert_eq!(results(&out), wanted);
    }
    // If no scenario is left, nothing is shown, and the reason is reported.
    fs::write(&file, document.to_string().replace("road-00", "street-")).unwrap();
    let output = reactsim(&["run", text(&plain), "--deviations", text(&file)]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(stderr(&output), @r"
    4 scenarios passed over: no deviated AV in the file of deviations
    warning: 3 deviations not used: for scenarios that are not among those that were read
    error: no scenario could be run: see the warnings above
    ");
}

#[test]
fn with_a_file_of_deviations_those_that_scenarios_carry_do_not_count() {
    let home = tempfile::tempdir().unwrap();
    let (carried, file) = (home.path().join("carried.parquet"), home.path().join("d.json"));
    write(&carried, (0..3).map(scenario));
    fs::write(&file, deviations(&[1]).to_string()).unwrap();
    let output = reactsim(&["run", text(&carried), "--deviations", text(&file), "--models", "stop"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    insta::assert_snapshot!(stderr(&output), @"2 scenarios passed over: no deviated AV in the file of deviations");
    assert!(stdout(&output).contains("1 scenario, 2 passed over, "), "{}", stdout(&output));
}

#[test]
fn scenarios_are_selected_by_id_and_category() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("run");
    let run = |more: &[&str]| reactsim(&[&["run", "--models", "stop", "--quiet"], more].concat());
    let (one, other) = ("bench-2-000002", "bench-2-000012");
    let output = run(&["--id", one, "--id", other, "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stdout(&output).contains("2 scenarios, 148 not selected, "), "{}", stdout(&output));
    // Positions are those in the whole file, so that the page finds the scenarios.
    let rows = fs::read_to_string(out.join("rows.jsonl")).unwrap();
    let records: std::collections::BTreeSet<usize> = rows
        .lines()
        .map(|line| serde_json::from_str::<reactsim::evaluation::Row>(line).unwrap().record)
        .collect();
    let listed = stdout(&reactsim(&["list", "scenarios"]));
    let position = |id: &str| listed.lines().position(|line| line.starts_with(id)).unwrap() - 1;
    assert_eq!(records, [position(one), position(other)].into());
    assert_eq!(listed.lines().count(), 151);
    // A resumed run with another selection is another run.
    let output = run(&["--id", one, "--out", text(&out), "--resume"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("selection"), "{}", stderr(&output));

    let lateral = stdout(&reactsim(&["list", "scenarios", "--category", "lateral"]));
    assert!(lateral.lines().skip(1).all(|line| line.contains(" lateral ")), "{lateral}");
    let output = run(&["--category", "lateral"]);
    let expected = format!("{} scenarios, ", lateral.lines().count() - 1);
    assert!(stdout(&output).contains(&expected), "{expected}: {}", stdout(&output));

    let output = run(&["--id", "bench-2-2"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(stderr(&output), @r"
    warning: no scenario has the id `bench-2-2`
    error: no scenario could be run: see the warnings above
    ");
}

#[test]
fn converted_files_have_the_selected_scenarios() {
    let home = tempfile::tempdir().unwrap();
    let (all, some) = (home.path().join("all.parquet"), home.path().join("some.parquet"));
    write(&all, (0..3).map(scenario));
    let convert = |more: &[&str]| reactsim(&[&["convert", text(&all), "--out", text(&some)], more].concat());
    let output = convert(&["--id", "road-001"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let ids: Vec<String> = reactsim::formats::open(&some).unwrap().map(|s| s.unwrap().id).collect();
    assert_eq!(ids, ["road-001"]);
    let output = convert(&["--id", "road-009"]);
    assert_eq!(output.status.code(), Some(2));
    insta::assert_snapshot!(
        stderr(&output),
        @"error: no scenario is selected: leave out --id, --category, --futures or --certificates"
    );
    let output = reactsim(&["inspect", text(&all), "--id", "road-01"]);
    let said = stderr(&output);
    assert!(said.contains("holds no scenario `road-01`; did you mean `road-001`?"), "{said}");
}

#[test]
fn conversion_changes_no_number() {
    let home = tempfile::tempdir().unwrap();
    let mini = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
    let native = home.path().join("mini.parquet");
    let output = reactsim(&["convert", mini, "--out", text(&native)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let metrics = |input: &str| {
        let output = reactsim(&["run", input, "--models", "stop", "--format", "json"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (summary["simulators"].clone(), summary["provenance"]["scenarios_blake3"].clone())
    };
    assert_eq!(metrics(mini), metrics(text(&native)));
    // A result never replaces its own source.
    let refused = reactsim(&["convert", text(&native), "--out", text(&native)]);
    assert_eq!(refused.status.code(), Some(2));
}
