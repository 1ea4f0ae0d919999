//! The program as its user calls it, and its files.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// Folder of the hand-made scenarios.
pub(crate) const MINI: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
/// File of the scenarios that are run by default.
pub(crate) const BENCH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/bench.parquet");

/// Returns a command for the program that was built with these tests.
pub(crate) fn program() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin!("reactsim"))
}

pub(crate) fn reactsim(arguments: &[&str]) -> Output {
    program().args(arguments).output().unwrap()
}

/// Runs the program, which must end with this code.
#[track_caller]
pub(crate) fn ended(arguments: &[&str], code: i32) -> Output {
    let output = reactsim(arguments);
    let (out, error) = (stdout(&output), stderr(&output));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {out} {error}");
    output
}

/// Returns stdout and stderr of a command that ends with this code.
#[track_caller]
pub(crate) fn said(arguments: &[&str], code: i32) -> (String, String) {
    let output = ended(arguments, code);
    (stdout(&output), stderr(&output))
}

/// Returns stderr of a command that is refused: it ends with code 2, without a result.
#[track_caller]
pub(crate) fn refused(arguments: &[&str]) -> String {
    let (out, error) = said(arguments, 2);
    assert_eq!(out, "", "{arguments:?} printed a result");
    error
}

/// Returns the result of a command, which it prints as JSON.
#[track_caller]
pub(crate) fn result(arguments: &[&str]) -> Value {
    serde_json::from_str(&said(&[arguments, &["--format", "json"]].concat(), 0).0).unwrap()
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Splits a command line, whose words have no spaces.
pub(crate) fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Starts a command and sends it a signal as soon as a condition holds, or lets it end if it is faster.
#[cfg(unix)]
pub(crate) fn signalled(command: &mut Command, signal: &str, is_time: impl Fn() -> bool) -> Output {
    use std::process::Stdio;
    use std::time::{Duration, Instant};

    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    while !is_time() && child.try_wait().unwrap().is_none() {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing to interrupt after a minute");
        std::thread::sleep(Duration::from_millis(1));
    }
    Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    child.wait_with_output().unwrap()
}

pub(crate) fn copy(from: &Path, to: &Path) -> PathBuf {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
    to.to_owned()
}

pub(crate) fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

pub(crate) fn lines_of(path: &Path) -> Vec<Value> {
    fs::read_to_string(path).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Returns the rows of the log of a training, without wall times.
pub(crate) fn log_rows(training: &Path) -> Vec<Value> {
    let mut rows = lines_of(&training.join("log.jsonl"));
    rows.iter_mut().for_each(|row| drop(row.as_object_mut().unwrap().remove("wall")));
    rows
}
