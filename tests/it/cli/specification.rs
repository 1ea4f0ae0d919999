//! Specifications of runs in files.

use std::fs;
use std::path::Path;

use crate::program::{reactsim, said, text};

/// Writes a file and returns its path.
fn file(home: &Path, content: &str) -> String {
    let path = home.join("spec.toml");
    fs::write(&path, content).unwrap();
    text(&path).to_owned()
}

#[test]
fn a_printed_specification_repeats_the_run() {
    let home = tempfile::tempdir().unwrap();
    let options = [
        "run",
        "--limit",
        "3",
        "--models",
        "idm@calm,constant-velocity",
        "--set",
        "idm@calm.vehicle.headway=2.5",
        "--av",
        "brake:4",
        "--replan",
        "1hz",
        "--seed",
        "7",
        "--rollouts",
        "2",
        "--metric-option",
        "fault_order=nuplan",
        "--smooth",
        "qp",
        "--av-lookahead",
        "0",
        "--backend",
        "flex",
    ];
    let (printed, _) = said(&[&options[..], &["--print-spec"]].concat(), 0);
    for line in ["replan = \"10steps\"", "av = \"brake:4\"", "seed = 7", "smooth = \"qp\"", "limit = 3"] {
        assert!(printed.lines().any(|found| found == line), "{line}: {printed}");
    }
    let spec = file(home.path(), &printed);
    let [first, second] = ["first", "second"].map(|name| home.path().join(name));
    said(&[&options[..], &["--out", text(&first)]].concat(), 0);
    said(&["run", &spec, "--out", text(&second)], 0);
    for name in ["provenance.json", "rows.jsonl", "summary.json"] {
        assert_eq!(
            fs::read_to_string(first.join(name)).unwrap(),
            fs::read_to_string(second.join(name)).unwrap()
        );
    }
    // What is printed again is the same.
    assert_eq!(said(&["run", &spec, "--print-spec"], 0).0, printed);
}

#[test]
fn options_take_precedence_over_a_file() {
    let home = tempfile::tempdir().unwrap();
    let spec = file(
        home.path(),
        "models = [\"idm\"]\nscenarios = [\"a.parquet\"]\nkeep-rollouts = true\nseed = 3\n",
    );
    let (printed, _) = said(&["run", &spec, "--models", "stop", "--keep-rollouts=false", "--print-spec"], 0);
    for line in ["models = [\"stop\"]", "scenarios = [\"a.parquet\"]", "keep-rollouts = false", "seed = 3"] {
        assert!(printed.lines().any(|found| found == line), "{line}: {printed}");
    }
    let (printed, _) = said(&["run", &spec, "b.parquet", "--print-spec"], 0);
    assert!(printed.contains("scenarios = [\"b.parquet\"]"), "{printed}");
}

#[test]
fn wrong_files_are_refused_by_name() {
    let home = tempfile::tempdir().unwrap();
    for (content, reason) in [
        ("modls = [\"idm\"]", "`modls` is not a key; did you mean `models`?"),
        ("seed = \"x\"", "seed"),
        ("replan = \"3hz\"", "is not a replan interval"),
        ("seed = ", "TOML parse error"),
        ("out = \"runs/a\"", "`out` is not a key"),
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
