//! Two runs compared: no difference if they are equal, and otherwise exactly the planted differences.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::program::{MINI, copy, said, text};

/// Writes a copy of a run folder with changed rows.
fn changed(run: &Path, to: &Path, mut change: impl FnMut(&mut Value)) {
    copy(run, to);
    let rows = fs::read_to_string(run.join("rows.jsonl")).unwrap();
    let changed = rows.lines().map(|line| {
        let mut row: Value = serde_json::from_str(line).unwrap();
        change(&mut row);
        format!("{row}\n")
    });
    fs::write(to.join("rows.jsonl"), changed.collect::<String>()).unwrap();
}

#[test]
fn what_was_planted_is_found_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (run, planted) = (at("run"), at("planted"));
    said(&["run", MINI, "--models", "constant-velocity,stop,idm", "--out", text(&run)], 0);

    let (table, _) = said(&["compare", text(&run), text(&run), "--worse", "aav-collision=0"], 0);
    assert_eq!(table.matches("constant-velocity: 12 scenarios").count(), 1, "{table}");
    let rows: Vec<Vec<&str>> = table
        .lines()
        .filter(|l| l.starts_with("| ") && !l.starts_with("| Metric"))
        .map(|l| l.split('|').map(str::trim).collect())
        .collect();
    assert!(rows.len() > 15, "{table}");
    for row in rows {
        assert!(row[5].starts_with("0.0"), "{row:?}");
        assert_eq!((row[6], row[7]), ("1.0000", "no difference seen"), "{row:?}");
        assert_eq!(row[9..11], ["0", "0"], "{row:?}");
    }
    assert!(!table.contains("Worse, "), "{table}");

    // Three more collisions in one scenario, for one simulator.
    let mut scenario = String::new();
    changed(&run, &planted, |row| {
        if row["simulator"] == "idm"
            && row["rollout"] == 0
            && (scenario.is_empty() || row["scenario"] == *scenario)
        {
            scenario = row["scenario"].as_str().unwrap().to_owned();
            let count = &mut row["metrics"]["aav-collision"]["count"];
            *count = (count.as_u64().unwrap() + 3).into();
        }
    });
    let compare =
        |more: &[&str], code| said(&[&["compare", text(&run), text(&planted)], more].concat(), code);
    let (json, _) = compare(&["--format", "json"], 0);
    let all: Value = serde_json::from_str(&json).unwrap();
    for comparison in all.as_array().unwrap() {
        for (metric, paired) in comparison["metrics"].as_object().unwrap() {
            let mean = paired["difference"]["mean"].as_f64().unwrap();
            let wanted = if comparison["first"] == "idm" && metric == "aav-collision" { 0.25 } else { 0.0 };
            assert!((mean - wanted).abs() < 1e-12, "{metric}: {mean}");
            assert_eq!(paired["p"], 1.0);
            assert_eq!(paired["verdict"], "no-difference-seen");
        }
    }
    let (table, _) = compare(&["--models", "idm,idm"], 0);
    assert!(table.contains(&format!("Worse, A-AV Coll.: {scenario} (+3.000)")), "{table}");
    let (_, error) = compare(&["--worse", "aav-collision=0.2"], 1);
    assert!(error.contains("`idm` got worse by more than aav-collision=0.2"), "{error}");
    compare(&["--worse", "aav-collision=0.3", "--worse", "offroad=0"], 0);
    // In the other direction it got better.
    said(&["compare", text(&planted), text(&run), "--worse", "aav-collision=0"], 0);

    // Two simulators of one run: standing agents collide with nobody.
    let (table, _) = said(&["compare", text(&run), text(&run), "--models", "constant-velocity,stop"], 0);
    assert!(table.contains("constant-velocity and stop: 12 scenarios"), "{table}");
}

#[test]
fn what_can_not_be_compared_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (run, other) = (at("run"), at("other"));
    said(&["run", MINI, "--models", "stop", "--limit", "2", "--out", text(&run)], 0);
    let refused = |arguments: &[&str]| said(&[&["compare"], arguments].concat(), 2).1;
    assert!(refused(&[text(&run), text(&at("none"))]).contains("none"));
    assert!(
        refused(&[text(&run), text(&run), "--models", "idm,stop"])
            .contains("no simulator `idm`; it has: stop")
    );
    assert!(refused(&[text(&run), text(&run), "--models", "stop"]).contains("--models names 1"));
    for (bound, part) in [
        ("aav-collision", "write METRIC=BOUND"),
        ("speed=1", "no metric `speed`"),
        ("aav-colision=1", "did you mean `aav-collision`?"),
        ("ade=-1", "`-1` is not a number of at least 0"),
        ("ade=nan", "`nan` is not a number"),
    ] {
        assert!(refused(&[text(&run), text(&run), "--worse", bound]).contains(part), "{bound}");
    }
    changed(&run, &other, |row| row["digest"] = "0".repeat(64).into());
    assert!(refused(&[text(&run), text(&other)]).contains("is not the same in both runs"));
    let strange = at("strange");
    changed(&run, &strange, |row| row["scenario"] = format!("x{}", row["scenario"].as_str().unwrap()).into());
    assert!(refused(&[text(&run), text(&strange)]).contains("no scenario in common"));
}

#[test]
fn damaged_rows_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let (run, other) = (folder.path().join("run"), folder.path().join("other"));
    said(&["run", MINI, "--models", "stop,idm", "--limit", "2", "--out", text(&run)], 0);
    changed(&run, &other, |_| {});
    let rows = other.join("rows.jsonl");
    let lines = fs::read_to_string(&rows).unwrap();
    let with = |content: String| {
        fs::write(&rows, content).unwrap();
        said(&["compare", text(&run), text(&other), "--worse", "aav-collision=0"], 2).1
    };
    let error = with(lines.replacen("\"simulator\"", "\"simul", 1));
    assert!(error.contains("rows.jsonl is damaged in line 1"), "{error}");
    let error = with(lines.lines().skip(1).map(|line| format!("{line}\n")).collect());
    assert!(error.contains("are incomplete"), "{error}");
}

#[test]
fn runs_under_other_conditions_are_compared_only_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (run, braking) = (at("run"), at("braking"));
    let base = ["run", MINI, "--models", "stop", "--limit", "2", "--out"];
    said(&[&base[..], &[text(&run)]].concat(), 0);
    said(
        &[&base[..], &[text(&braking), "--av", "brake:4", "--metric-option", "fault_order=nuplan"]].concat(),
        0,
    );
    let compare =
        |more: &[&str], code| said(&[&["compare", text(&run), text(&braking)], more].concat(), code);
    let (_, error) = compare(&[], 2);
    for part in ["  av: deviated and brake:4", "  metric-options: none and fault_order=nuplan"] {
        assert!(error.contains(part), "{error}");
    }
    let (_, error) = compare(&["--despite", "av"], 2);
    assert!(!error.contains("  av:") && error.contains("--despite av,metric-options"), "{error}");
    let (table, _) = compare(&["--despite", "av,metric-options"], 0);
    assert!(table.contains("The runs differ in `av`: deviated and brake:4."), "{table}");
    assert!(compare(&["--despite", "weather"], 2).1.contains("expected one of protocol, av"));
}
