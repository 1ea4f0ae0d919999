//! Two processes that want one folder.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};

use reactsim::files::lock_folder;

use super::trainings::{prepare, train};
use crate::program::{log_rows, program, stderr};
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
    let said = both.map(|output| stderr(&output));
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

/// Commands that write a folder; `IN` is a file of scenarios.
const WRITERS: [&str; 8] = [
    "run IN --models stop --out",
    "study replan IN --models stop --out",
    "train ntp-reactive IN --out",
    "train adapt IN --model regression --minutes 0.05 --out",
    "train adapt IN --model regression --minutes 0.05 --resume --out",
    "train quick --out",
    "train split IN --part a=0.5 --part b=0.5 --out",
    "man --out",
];

#[test]
fn no_command_writes_a_folder_that_another_process_has_locked() {
    let home = tempfile::tempdir().unwrap();
    let (input, out) = (home.path().join("in.parquet"), home.path().join("out"));
    write(&input, (0..8).map(scenario));
    fs::create_dir(&out).unwrap();
    let lock = lock_folder(&out).unwrap();
    assert!(lock.is_some());
    for line in WRITERS {
        let words = line.split(' ').map(|word| if word == "IN" { input.to_str().unwrap() } else { word });
        let output = program().args(words).arg(&out).output().unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains(" is writing to ") && said.contains("/out"), "{line}: {said}");
        let names: Vec<_> = fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names, [".lock"], "{line}");
    }
}

#[test]
#[ignore = "starts two hundred processes"]
fn of_two_processes_that_want_one_folder_one_is_refused_every_time() {
    attack(50);
}
