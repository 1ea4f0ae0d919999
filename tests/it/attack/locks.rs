//! Two processes that want one folder.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};

use super::trainings::{prepare, train};
use crate::program::{log_rows, program};
use crate::small_scenarios::{scenario, write};

fn run(input: &Path, out: &Path) -> Child {
    let mut command = program();
    command
        .arg("run")
        .arg(input)
        .args(["--models", "stop", "--rollouts", "3", "--jobs", "1", "--out"])
        .arg(out);
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Starts two processes together, and checks that one is refused.
fn race(begin: impl Fn() -> Child) {
    let both = [begin(), begin()].map(|child| child.wait_with_output().unwrap());
    let mut codes = both.each_ref().map(|output| output.status.code());
    codes.sort();
    let said = both.map(|output| String::from_utf8_lossy(&output.stderr).into_owned());
    assert_eq!(codes, [Some(0), Some(2)], "{said:?}");
}

fn attack(times: u32) {
    let home = tempfile::tempdir().unwrap();
    prepare(home.path());
    let input = home.path().join("some.parquet");
    write(&input, (0..4).map(scenario));
    for k in 0..times {
        let (trained, out) =
            (home.path().join(format!("training-{k}")), home.path().join(format!("run-{k}")));
        race(|| train(home.path(), &trained, false));
        let rows = log_rows(&trained);
        let steps: Vec<u64> =
            rows.iter().filter(|row| row["row"] == "step").filter_map(|row| row["step"].as_u64()).collect();
        assert!(steps.windows(2).all(|two| two[0] < two[1]), "rows are doubled: {steps:?}");
        race(|| run(&input, &out));
        let rows = fs::read_to_string(out.join("rows.jsonl")).unwrap();
        assert_eq!(rows.lines().count(), 4 * (3 + 1));
        for folder in [trained, out] {
            assert!(!folder.join(".lock").exists());
        }
    }
}

#[test]
fn of_two_processes_that_want_one_folder_one_is_refused() {
    attack(2);
}

#[test]
#[ignore = "starts two hundred processes"]
fn of_two_processes_that_want_one_folder_one_is_refused_every_time() {
    attack(50);
}
