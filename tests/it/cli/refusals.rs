//! Input that is refused, in whole or in part.

use std::fs;

use super::{stderr, stdout, text};
use crate::program::reactsim;
use crate::small_scenarios::{deviating, scenario, write};

#[test]
fn wrong_input_names_the_mend_and_exits_with_2() {
    let home = tempfile::tempdir().unwrap();
    let plain = home.path().join("plain.parquet");
    write(&plain, (0..2).map(|i| deviating(i, false)));
    let error = |arguments: &[&str]| {
        let output = reactsim(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
        stderr(&output).replace(text(home.path()), "HOME")
    };
    let unknown = error(&["run", "--models", "idmm"]);
    assert!(unknown.starts_with("error: there is no simulator `idmm`; there are: log-replay, "), "{unknown}");
    assert!(unknown.contains("\nhint: did you mean `idm`? `reactsim list models`"), "{unknown}");
    insta::assert_snapshot!(error(&["run", text(&plain)]), @r"error: the scenarios have no deviated AV: give --deviations <file>, or choose a driver with --av: deviated, log, deviated-or-log, constant-velocity, brake:<m/s²>, retime:<factor>, shift:<m>, file:<path> or planner:<id>");
    insta::assert_snapshot!(error(&["run", "--metric-option", "fault_order=mine"]), @r"error: metric option `fault_order` is `mine`, expected `paper` or `nuplan`");
    insta::assert_snapshot!(error(&["run", "--protocol", "realism", "--av", "log"]), @r"error: the simulator moves the AV in the realism protocol: leave --av out");
    insta::assert_snapshot!(error(&["run", "--av", "log", "--deviations", "x.json"]), @r"error: --deviations goes with --av deviated or deviated-or-log only");
    insta::assert_snapshot!(error(&["run", "--models", "stop,stop"]), @r"error: the simulator `stop` is named twice");
    insta::assert_snapshot!(error(&["report", text(home.path())]), @r"
    error: HOME is not a run folder: it has no provenance.json
    hint: `reactsim run --out FOLDER` writes a run folder
    ");
    assert!(error(&["run", "--av", "brake:9"]).contains("a deceleration above 0 and at most 6 m/s²"));
    assert!(error(&["run", "--replan", "3hz"]).contains("such as `2hz`"));
    assert!(error(&["run", "--rollouts", "0"]).contains("1..=10000"));
    assert!(error(&["run", "--resume"]).contains("--out"));
    assert!(error(&["run", "--jobs", "100000"]).contains("1..=1024"));
    assert!(
        error(&["inspect", text(&plain), "--rollout", "HOME", "--simulator", "idm"]).contains("--svg <FILE>")
    );
    #[cfg(unix)]
    assert!(error(&["convert", text(&plain), "--out", "/dev/null"]).contains("is not a regular file"));
    assert!(error(&["run", "HOME/absent"]).contains("HOME/absent"));
    assert!(error(&["run", text(&plain), "--deviations", "absent.json"]).contains("absent.json"));
    // The parent of the folder is a file.
    let taken = home.path().join("plain.parquet/run");
    assert!(error(&["run", "--out", text(&taken)]).contains("could not write HOME/plain.parquet/run"));
}

#[test]
fn failed_scenarios_are_listed_and_the_rest_is_in_the_table() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("some.parquet"), home.path().join("run"));
    write(&input, (0..4).map(|i| deviating(i, i != 2)));
    let output =
        reactsim(&["run", text(&input), "--models", "stop", "--av", "deviated", "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(1));
    insta::assert_snapshot!(stderr(&output), @r"
    warning: failed: some.parquet: record 2: scenario `road-002`: no deviated AV; give --deviations with one for this scenario, or choose another --av
    warning: 1 failed; the others are in the table
    ");
    assert!(stdout(&output).contains("3 scenarios, 1 failure"));
    let failures = fs::read_to_string(out.join("failures.jsonl")).unwrap();
    assert_eq!(failures.lines().count(), 1);
    assert!(failures.contains("road-002"), "{failures}");
    assert!(fs::read_to_string(out.join("summary.md")).unwrap().contains("Failed:"));
    // If every scenario fails, there is nothing to show.
    write(&input, [deviating(2, false)]);
    let output = reactsim(&["run", text(&input), "--av", "deviated"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("no scenario could be run"));
}

#[test]
fn files_that_only_look_like_scenarios_are_named() {
    let home = tempfile::tempdir().unwrap();
    write(&home.path().join("a.parquet"), [deviating(0, true)]);
    fs::write(home.path().join("b.json"), "{").unwrap();
    fs::write(home.path().join("notes.txt"), "no scenario, and not named like one").unwrap();
    let output = reactsim(&["run", text(home.path()), "--models", "stop"]);
    assert_eq!(output.status.code(), Some(0));
    let said = stderr(&output);
    assert!(said.contains("b.json is skipped: it is not a scenario file"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

#[test]
fn a_damaged_file_does_not_stop_the_others() {
    let home = tempfile::tempdir().unwrap();
    let (good, bad) = (home.path().join("a.parquet"), home.path().join("b.parquet"));
    write(&good, (0..2).map(scenario));
    let bytes = fs::read(&good).unwrap();
    fs::write(&bad, &bytes[..bytes.len() / 2]).unwrap();
    let output = reactsim(&["run", text(home.path()), "--models", "stop", "--format", "csv"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("b.parquet"), "{}", stderr(&output));
    assert!(stdout(&output).contains("stop,false,mean,,,aav-collision,"));
}

#[test]
fn misspelt_names_are_answered_with_the_most_similar_one() {
    let meant = |arguments: &[&str], expected: &str| {
        let output = reactsim(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
    };
    meant(&["run", "--models", "imd"], "did you mean `idm`?");
    meant(
        &["run", "--models", "idm", "--set", "idm.vehicle.headwy=2"],
        "did you mean `idm.vehicle.headway`?",
    );
    meant(&["run", "--metric-option", "faul_order=nuplan"], "did you mean `fault_order`?");
    meant(&["list", "parameters", "ntp_reactive"], "did you mean `ntp-reactive`?");
    meant(&["inspect", "--case", "turn-acros"], "did you mean `turn-across`?");
    meant(&["compare", "a", "b", "--worse", "aav-colision=1"], "did you mean `aav-collision`?");
    meant(&["compare", "a", "b"], "hint: `reactsim run --out FOLDER` writes a run folder");
}
