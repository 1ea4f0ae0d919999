//! Specifications of runs in files.

use std::fs;
use std::path::Path;

use crate::program::{program, reactsim, said, text, words};
use crate::small_scenarios::{deviations, scenario, write};

fn file(home: &Path, content: &str) -> String {
    let path = home.join("spec.toml");
    fs::write(&path, content).unwrap();
    text(&path).to_owned()
}

#[test]
fn a_printed_specification_repeats_the_run() {
    let home = tempfile::tempdir().unwrap();
    let options = words(
        "run --limit 3 --models idm@calm,constant-velocity --set idm@calm.vehicle.headway=2.5 --av brake:4 \
         --replan 1hz --seed 7 --rollouts 2 --metric-option fault_order=nuplan --smooth qp --av-lookahead 0 \
         --backend flex",
    );
    let (printed, _) = said(&[&options[..], &["--print-spec"]].concat(), 0);
    for line in ["replan = \"10steps\"", "av = \"brake:4\"", "seed = 7", "smooth = \"qp\"", "limit = 3"] {
        assert!(printed.lines().any(|found| found == line), "{line}: {printed}");
    }
    let spec = file(home.path(), &printed);
    let [first, second] = ["first", "second"].map(|name| home.path().join(name));
    said(&[&options[..], &["--out", text(&first)]].concat(), 0);
    said(&["run", &spec, "--out", text(&second)], 0);
    assert_eq!(fs::read_to_string(first.join("spec.toml")).unwrap(), printed);
    for name in ["provenance.json", "rows.jsonl", "summary.json", "spec.toml"] {
        assert_eq!(
            fs::read_to_string(first.join(name)).unwrap(),
            fs::read_to_string(second.join(name)).unwrap()
        );
    }
    // What is printed again is the same.
    assert_eq!(said(&["run", &spec, "--print-spec"], 0).0, printed);
}

#[test]
fn a_run_folder_repeats_its_run_wherever_it_is_called_from() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path().canonicalize().unwrap();
    fs::create_dir_all(home.join("data/logs")).unwrap();
    write(&home.join("data/logs/mine.parquet"), (0..3).map(scenario));
    fs::write(home.join("data/deviations.json"), deviations(&[0, 2]).to_string()).unwrap();
    let call = |folder: &str, arguments: &[&str]| {
        let output = program().args(arguments).current_dir(home.join(folder)).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    let options = ["--models", "stop", "--av", "file:deviations.json", "--keep-rollouts"];
    call("data", &[&["run", "logs", "--out", "../runs/first"], &options[..]].concat());
    let text = fs::read_to_string(home.join("runs/first/spec.toml")).unwrap();
    for line in ["scenarios = [\"../../data/logs\"]", "deviations = \"../../data/deviations.json\""] {
        assert!(text.lines().any(|found| found == line), "{line}: {text}");
    }
    // All of it is moved.
    fs::create_dir(home.join("moved")).unwrap();
    ["data", "runs"]
        .iter()
        .for_each(|name| fs::rename(home.join(name), home.join("moved").join(name)).unwrap());
    call(".", &["run", "moved/runs/first/spec.toml", "--out", "moved/runs/second"]);
    call("moved/runs", &["run", "first/spec.toml", "--out", "third"]);
    for name in ["provenance.json", "rows.jsonl", "summary.json", "spec.toml", "rollouts.parquet"] {
        let of = |run: &str| fs::read(home.join("moved/runs").join(run).join(name)).unwrap();
        assert!(of("first") == of("second") && of("first") == of("third"), "{name}");
    }
}

#[test]
fn options_take_precedence_over_a_file() {
    let home = tempfile::tempdir().unwrap();
    let spec = file(
        home.path(),
        "models = [\"idm\"]\nscenarios = [\"a.parquet\"]\nkeep-rollouts = true\nseed = 3\nreplan = 10\n",
    );
    let (printed, _) = said(&["run", &spec, "--models", "stop", "--keep-rollouts=false", "--print-spec"], 0);
    // Paths in a file are those of its folder.
    let scenarios = format!("scenarios = [{:?}]", home.path().join("a.parquet"));
    for line in
        ["models = [\"stop\"]", &scenarios, "keep-rollouts = false", "seed = 3", "replan = \"10steps\""]
    {
        assert!(printed.lines().any(|found| found == line), "{line}: {printed}");
    }
    let (printed, _) = said(&["run", &spec, "b.parquet", "--print-spec"], 0);
    // Those of the command line are those of the current folder, wherever the output is saved.
    let scenarios = format!("scenarios = [{:?}]", std::env::current_dir().unwrap().join("b.parquet"));
    assert!(printed.lines().any(|found| found == scenarios), "{printed}");
    let saved = file(home.path(), &printed);
    assert_eq!(said(&["run", &saved, "--print-spec"], 0).0, printed);
}

#[test]
fn wrong_files_are_refused_by_name() {
    let home = tempfile::tempdir().unwrap();
    for (content, reason) in [
        ("modls = [\"idm\"]", "`modls` is not a key; did you mean `models`?"),
        ("models = \"idm\"", "models: invalid type: string \"idm\""),
        ("limit = \"3\"", "limit: invalid type: string"),
        ("replan = true", "replan: expected a text"),
        ("seed = \"x\"", "seed: `x`: invalid digit"),
        ("replan = \"3hz\"", "is not a replan interval"),
        ("seed = ", "TOML parse error"),
        ("out = \"runs/a\"", "`out` is not a key"),
        ("av-lookahead = 2", "av-lookahead `2`: write 0 or 1"),
    ] {
        let spec = file(home.path(), content);
        let output = reactsim(&["run", &spec]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{content}");
        assert!(message.contains(reason) && message.contains("spec.toml"), "{content}: {message}");
    }
    let absent = reactsim(&["run", "absent.toml"]);
    assert!(String::from_utf8_lossy(&absent.stderr).contains("absent.toml"));
}

#[test]
fn options_complete_a_file() {
    let home = tempfile::tempdir().unwrap();
    let spec = file(home.path(), "external = [\"mine=true\"]\nnuplan = [\"logs\"]\nfilter = \"a.yaml\"\n");
    let options = ["--reveal-ids", "--filter", "b.yaml", "--seed", "18446744073709551615", "--print-spec"];
    let (printed, _) = said(&[&["run", &spec], &options[..]].concat(), 0);
    let filter = format!("filter = {:?}", std::env::current_dir().unwrap().join("b.yaml"));
    for line in ["reveal-ids = true", &filter, "seed = \"18446744073709551615\""] {
        assert!(printed.lines().any(|found| found == line), "{line}: {printed}");
    }
    let saved = file(home.path(), &printed);
    assert_eq!(said(&["run", &saved, "--print-spec"], 0).0, printed);
}
