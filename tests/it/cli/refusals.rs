//! Input that is refused, in whole or in part.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::program::{MINI, lines_of, refused, said, text, words};
use crate::small_scenarios::{deviating, scenario, write};

#[test]
fn wrong_input_names_the_mend_and_exits_with_2() {
    let home = tempfile::tempdir().unwrap();
    let plain = home.path().join("plain.parquet");
    write(&plain, (0..2).map(|i| deviating(i, false)));
    let error = |arguments: &[&str]| refused(arguments).replace(text(home.path()), "HOME");
    let unknown = error(&["run", "--models", "idmm"]);
    assert!(unknown.starts_with("error: there is no simulator `idmm`; there are: log-replay, "), "{unknown}");
    assert!(unknown.contains("\nhint: did you mean `idm`? `reactsim list models`"), "{unknown}");
    insta::assert_snapshot!(error(&["run", text(&plain)]), @r"error: the scenarios have no deviated AV: give `deviations`, or choose a driver with `av`: deviated, log, deviated-or-log, constant-velocity, brake:<m/s²>, retime:<factor>, shift:<m>, file:<path> or planner:<id>");
    insta::assert_snapshot!(error(&["run", "--protocol", "realism", "--av", "log"]), @r"error: the simulator moves the AV in the realism protocol: leave `av` out");
    insta::assert_snapshot!(error(&["run", "--av", "log", "--deviations", "x.json"]), @r"error: `deviations` goes with `av` deviated or deviated-or-log only");
    insta::assert_snapshot!(error(&["run", "--models", "stop,stop"]), @r"error: the simulator `stop` is named twice");
    insta::assert_snapshot!(error(&["report", text(home.path())]), @r"
    error: HOME is not a run folder: it has no provenance.json
    hint: `reactsim run --out FOLDER` writes a run folder
    ");
    for (arguments, part) in [
        (&["run", "--av", "brake:9"][..], "a deceleration above 0 and at most 6 m/s²"),
        (&["run", "--replan", "3hz"], "such as `2hz`"),
        (&["run", "--rollouts", "0"], "1..=10000"),
        (&["run", "--resume"], "--out"),
        (&["run", "--jobs", "100000"], "1..=1024"),
        (&["run", "--limit", "-1"], "invalid value '-1' for '--limit"),
        (&["inspect", text(&plain), "--rollout", "HOME", "--simulator", "idm"], "--svg <FILE>"),
        (&["run", "HOME/absent"], "HOME/absent"),
        (&["run", text(&plain), "--deviations", "absent.json"], "absent.json"),
    ] {
        assert!(error(arguments).contains(part), "{part}: {}", error(arguments));
    }
    #[cfg(unix)]
    assert!(error(&["convert", text(&plain), "--out", "/dev/null"]).contains("is not a regular file"));
    // The parent of the folder is a file.
    let taken = home.path().join("plain.parquet/run");
    assert!(error(&["run", "--out", text(&taken)]).contains("could not write HOME/plain.parquet/run"));
}

#[test]
fn failed_scenarios_are_listed_and_the_rest_is_in_the_table() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("some.parquet"), home.path().join("run"));
    write(&input, (0..4).map(|i| deviating(i, i != 2)));
    let run = ["run", text(&input), "--models", "stop", "--av", "deviated"];
    let (table, warnings) = said(&[&run[..], &["--out", text(&out)]].concat(), 1);
    insta::assert_snapshot!(warnings, @r"
    warning: failed: some.parquet: record 2: scenario `road-002`: no deviated AV; give `deviations` with one for this scenario, or choose another `av`
    warning: 1 failed; the others are in the table
    ");
    assert!(table.contains("3 scenarios, 1 failure"));
    let failures = lines_of(&out.join("failures.jsonl"));
    assert_eq!((failures.len(), failures[0]["scenario"].as_str()), (1, Some("road-002")));
    assert!(fs::read_to_string(out.join("summary.md")).unwrap().contains("Failed:"));
    // If every scenario fails, there is nothing to show.
    write(&input, [deviating(2, false)]);
    assert!(said(&run, 2).1.contains("no scenario could be run"));
}

#[test]
fn files_that_only_look_like_scenarios_are_named() {
    let home = tempfile::tempdir().unwrap();
    write(&home.path().join("a.parquet"), [deviating(0, true)]);
    fs::write(home.path().join("b.json"), "{").unwrap();
    fs::write(home.path().join("notes.txt"), "no scenario, and not named like one").unwrap();
    let (_, said) = said(&["run", text(home.path()), "--models", "stop"], 0);
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
    let (table, error) = said(&["run", text(home.path()), "--models", "stop", "--format", "csv"], 1);
    assert!(error.contains("b.parquet"), "{error}");
    assert!(table.contains("stop,false,mean,,,aav-collision,"));
}

#[test]
fn misspelt_names_are_answered_with_the_most_similar_one() {
    for (line, expected) in [
        ("run --models imd", "did you mean `idm`?"),
        ("run --models idm --set idm.vehicle.headwy=2", "did you mean `idm.vehicle.headway`?"),
        ("run --metric-option faul_order=nuplan", "did you mean `fault_order`?"),
        ("list parameters ntp_reactive", "did you mean `ntp-reactive`?"),
        ("inspect --case turn-acros", "did you mean `turn-across`?"),
        ("compare a b", "hint: `reactsim run --out FOLDER` writes a run folder"),
    ] {
        let error = refused(&words(line));
        assert!(error.contains(expected), "{line}: {error}");
    }
}

#[test]
#[cfg(unix)]
fn pipes_and_devices_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("scenario.json");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for path in [text(&pipe), "/dev/zero"] {
        for command in ["score", "run", "inspect", "run --deviations"] {
            let error = refused(&[&words(command)[..], &[path]].concat());
            assert!(error.contains("a pipe or a device"), "{command}: {error}");
        }
    }
    // In a folder, the pipe is passed over.
    fs::copy(Path::new(MINI).join("crossing.json"), folder.path().join("b.json")).unwrap();
    said(&["run", text(folder.path()), "--models", "stop"], 0);
}
