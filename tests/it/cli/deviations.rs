//! Selected and converted scenarios, and deviations from files.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use super::results;
use crate::program::{MINI, ended, json_of, lines_of, refused, result, said, text};
use crate::small_scenarios::{deviating, deviations, scenario, write};

#[test]
fn deviations_from_a_file_are_those_that_scenarios_carry() {
    let home = tempfile::tempdir().unwrap();
    let (carried, plain) = (home.path().join("carried.parquet"), home.path().join("plain.parquet"));
    write(&carried, (0..3).map(scenario));
    write(&plain, (0..3).map(|i| deviating(i, false)));
    let file = home.path().join("deviations.json");
    let mut document = deviations(&[0, 1, 2]);
    document["frame"] = "world".into();
    fs::write(&file, document.to_string()).unwrap();
    let run = |input: &Path, more: &[&str], code| {
        let common = ["--models", "log-replay,stop", "--format", "json"];
        let (summary, warnings) = said(&[&["run", text(input)], &common[..], more].concat(), code);
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        (summary["simulators"].clone(), warnings)
    };
    let (wanted, _) = run(&carried, &[], 0);
    let named = format!("file:{}", text(&file));
    for choice in [["--deviations", text(&file)], ["--av", &named]] {
        assert_eq!(run(&plain, &choice, 0).0, wanted);
    }
    // One scenario without a trajectory, one with a trajectory that was made for another version of it.
    document["deviations"].as_array_mut().unwrap().pop();
    document["deviations"][1]["scenario_digest"] = "0".repeat(64).into();
    fs::write(&file, document.to_string()).unwrap();
    let (simulators, warnings) = run(&plain, &["--deviations", text(&file)], 1);
    let made_for = "`road-001`: the deviated AV was made for a scenario with the digest 000";
    for part in [made_for, "1 scenario passed over: no deviated AV in the file of deviations"] {
        assert!(warnings.contains(part), "{warnings}");
    }
    assert_eq!(simulators["stop"]["scenarios"], 1);
}

#[test]
fn scenarios_without_a_deviation_in_the_file_are_passed_over() {
    let home = tempfile::tempdir().unwrap();
    let (plain, file) = (home.path().join("plain.parquet"), home.path().join("d.json"));
    write(&plain, (0..4).map(|i| deviating(i, false)));
    let document = deviations(&[0, 2, 7]);
    fs::write(&file, document.to_string()).unwrap();
    let out = home.path().join("run");
    let run = ["run", text(&plain), "--deviations", text(&file), "--models", "stop"];
    let arguments = [&run[..], &["--out", text(&out)]].concat();
    let (table, warnings) = said(&arguments, 0);
    insta::assert_snapshot!(warnings, @r"
    2 scenarios passed over: no deviated AV in the file of deviations
    warning: 1 deviation not used: for scenarios that are not among those that were read
    ");
    // Scenarios beyond the limit are not read, so their deviations are not used either.
    let (_, limited) = said(&[&run[..], &["--limit", "1"]].concat(), 0);
    insta::assert_snapshot!(limited, @"warning: 2 deviations not used: for scenarios that are not among those that were read");
    assert!(table.contains("2 scenarios, 2 passed over, "), "{table}");
    // Others are listed neither; a limit counts those that are.
    let list = ["list", "scenarios", text(&plain), "--deviations", text(&file), "--limit", "2"];
    let listed = said(&list, 0).0;
    let ids: Vec<&str> = listed.lines().skip(1).filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(ids, ["road-000", "road-002"]);
    let wanted = results(&out);
    let summary = json_of(&out.join("summary.json"));
    let counts = |key: &str| summary["provenance"][key].as_u64().unwrap();
    assert_eq!((counts("scenarios"), counts("passed_over"), counts("unused_deviations")), (2, 2, 1));
    // A resumed run counts the same, whatever was written before.
    for rows in [2, 0] {
        let text: String = String::from_utf8(wanted[1].clone()).unwrap();
        let kept: String = text.lines().take(rows).map(|l| format!("{l}\n")).collect();
        fs::write(out.join("rows.jsonl"), kept).unwrap();
        ended(&[&arguments[..], &["--resume"]].concat(), 0);
        assert_eq!(results(&out), wanted);
    }
    // If no scenario is left, nothing is shown, and the reason is reported.
    fs::write(&file, document.to_string().replace("road-00", "street-")).unwrap();
    insta::assert_snapshot!(refused(&run), @r"
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
    let (table, warnings) =
        said(&["run", text(&carried), "--deviations", text(&file), "--models", "stop"], 0);
    insta::assert_snapshot!(warnings, @"2 scenarios passed over: no deviated AV in the file of deviations");
    assert!(table.contains("1 scenario, 2 passed over, "), "{table}");
}

#[test]
fn scenarios_are_selected_by_id_and_category() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("run");
    let run = |more: &[&str], code| said(&[&["run", "--models", "stop", "--quiet"], more].concat(), code);
    let (one, other) = ("bench-2-000002", "bench-2-000012");
    let (table, _) = run(&["--id", one, "--id", other, "--out", text(&out)], 0);
    assert!(table.contains("2 scenarios, 148 not selected, "), "{table}");
    // Positions are those in the whole file, so that the page finds the scenarios.
    let rows = lines_of(&out.join("rows.jsonl"));
    let records: BTreeSet<u64> = rows.iter().filter_map(|row| row["record"].as_u64()).collect();
    let (listed, _) = said(&["list", "scenarios"], 0);
    let position = |id: &str| listed.lines().position(|line| line.starts_with(id)).unwrap() as u64 - 1;
    assert_eq!(records, [position(one), position(other)].into());
    assert_eq!(listed.lines().count(), 151);
    // A resumed run with another selection is another run.
    let (_, error) = run(&["--id", one, "--out", text(&out), "--resume"], 2);
    assert!(error.contains("selection"), "{error}");

    let (lateral, _) = said(&["list", "scenarios", "--category", "lateral"], 0);
    assert!(lateral.lines().skip(1).all(|line| line.contains(" lateral ")), "{lateral}");
    let (table, _) = run(&["--category", "lateral"], 0);
    let expected = format!("{} scenarios, ", lateral.lines().count() - 1);
    assert!(table.contains(&expected), "{expected}: {table}");
    insta::assert_snapshot!(run(&["--id", "bench-2-2"], 2).1, @r"
    warning: no scenario has the id `bench-2-2`
    error: no scenario could be run: see the warnings above
    ");
}

#[test]
fn converted_files_have_the_selected_scenarios() {
    let home = tempfile::tempdir().unwrap();
    let (all, some) = (home.path().join("all.parquet"), home.path().join("some.parquet"));
    write(&all, (0..3).map(scenario));
    let convert = ["convert", text(&all), "--out", text(&some), "--id"];
    said(&[&convert[..], &["road-001"]].concat(), 0);
    let ids: Vec<String> = reactsim::formats::open(&some).unwrap().map(|s| s.unwrap().id).collect();
    assert_eq!(ids, ["road-001"]);
    insta::assert_snapshot!(
        refused(&[&convert[..], &["road-009"]].concat()),
        @"error: no scenario is selected: leave out --id, --category, --futures or --certificates"
    );
    let error = refused(&["inspect", text(&all), "--id", "road-01"]);
    assert!(error.contains("holds no scenario `road-01`; did you mean `road-001`?"), "{error}");
}

#[test]
fn conversion_changes_no_number() {
    let home = tempfile::tempdir().unwrap();
    let native = home.path().join("mini.parquet");
    said(&["convert", MINI, "--out", text(&native)], 0);
    let metrics = |input: &str| {
        let summary = result(&["run", input, "--models", "stop"]);
        (summary["simulators"].clone(), summary["provenance"]["scenarios_blake3"].clone())
    };
    assert_eq!(metrics(MINI), metrics(text(&native)));
}
