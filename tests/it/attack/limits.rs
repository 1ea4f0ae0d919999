//! Small limits of the system: sizes of files, full devices, memory.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::program::{MINI, stderr};

/// Runs the program in a shell after some commands.
fn after(commands: &str, arguments: &[&str], folder: &Path) -> Output {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{commands}; exec \"$@\""), "sh"]);
    command
        .arg(assert_cmd::cargo::cargo_bin!("reactsim"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

#[test]
#[cfg(unix)]
fn files_that_become_too_large_are_an_error_and_leave_nothing() {
    let home = tempfile::tempdir().unwrap();
    let mini = MINI;
    fs::write(home.path().join("old.parquet"), "").unwrap();
    for out in ["new.parquet", "old.parquet"] {
        // In units of 512 or 1024 bytes.
        let output = after("ulimit -f 8", &["convert", mini, "--out", out], home.path());
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(out) && said.contains("too large"), "{said}");
    }
    let vocabulary = ["train", "vocabulary", "--method", "kinematic", "--out", "v.safetensors"];
    let output = after("ulimit -f 4", &vocabulary, home.path());
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.starts_with("error: could not write"), "{said}");
    let left: Vec<_> = fs::read_dir(home.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["old.parquet"]);
    assert_eq!(fs::read(home.path().join("old.parquet")).unwrap(), b"");
}

#[test]
#[cfg(target_os = "linux")]
fn a_small_address_space_is_named() {
    let home = tempfile::tempdir().unwrap();
    let output = after("ulimit -v 240000", &["list", "models"], home.path());
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("limited to 234 MiB (`ulimit -v`)"), "{}", stderr(&output));
}

#[test]
#[cfg(target_os = "linux")]
fn output_to_a_full_device_is_an_error() {
    let home = tempfile::tempdir().unwrap();
    for arguments in [&["--help"][..], &["--version"], &["run", "--help"], &["list", "models"]] {
        let output = after("exec >/dev/full", arguments, home.path());
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("could not write to stdout"), "{arguments:?}: {said}");
    }
}
