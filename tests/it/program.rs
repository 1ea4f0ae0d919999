//! The program as its user calls it.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// Returns a command for the program that was built with these tests.
pub(crate) fn program() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin!("reactsim"))
}

/// Runs the program with these arguments.
pub(crate) fn reactsim(arguments: &[&str]) -> Output {
    program().args(arguments).output().unwrap()
}

/// Returns the rows of the log of a training, without wall times.
pub(crate) fn log_rows(training: &Path) -> Vec<Value> {
    let log = fs::read_to_string(training.join("log.jsonl")).unwrap();
    let mut rows: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    rows.iter_mut().for_each(|row| drop(row.as_object_mut().unwrap().remove("wall")));
    rows
}
