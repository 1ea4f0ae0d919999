//! Runs that are killed or interrupted, and their folders.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use crate::program::{MINI, program, said, text};

/// Finishes a run of two scenarios that keeps its rollouts, or resumes it. Returns what it prints to stderr.
fn run(folder: &Path, resume: &[&str], code: i32) -> String {
    let out = folder.join("run");
    let models = ["--models", "constant-velocity,stop", "--keep-rollouts", "--out", text(&out)];
    said(&[&["run", MINI, "--limit", "2"], &models[..], resume].concat(), code).1
}

const RESUME: &[&str] = &["--resume"];

#[test]
fn a_run_killed_while_it_removes_its_parts_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &[], 0);
    let out = folder.path().join("run");
    let rollouts = fs::read(out.join("rollouts.parquet")).unwrap();
    fs::create_dir(out.join("parts")).unwrap();
    fs::copy(out.join("rollouts.parquet"), out.join("parts/000000-00000001-000.parquet")).unwrap();
    run(folder.path(), RESUME, 0);
    assert!(!out.join("parts").exists());
    assert!(fs::read(out.join("rollouts.parquet")).unwrap() == rollouts);
}

#[test]
fn lost_events_are_counted_again_and_damaged_ones_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &[], 0);
    let path = folder.path().join("run/events.jsonl");
    let events = fs::read_to_string(&path).unwrap();
    assert!(events.contains("\"metric\":\"aav-collision\""), "{events}");
    fs::write(&path, "").unwrap();
    run(folder.path(), RESUME, 0);
    assert_eq!(fs::read_to_string(&path).unwrap(), events);
    fs::write(&path, events.replacen("\"input\"", "\"inp", 1)).unwrap();
    let refused = run(folder.path(), RESUME, 2);
    assert!(refused.contains("events.jsonl is damaged in line 1"), "{refused}");
}

/// A full disk is in `attack::limits`.
#[test]
fn a_reader_that_goes_away_is_no_error() {
    let mut child = program().args(["list", "metrics"]).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
}

#[test]
fn truncated_rollouts_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &[], 0);
    let out = folder.path().join("run");
    let (file, part) = (out.join("rollouts.parquet"), out.join("parts/000000-00000000-000.parquet"));
    let rollouts = fs::read(&file).unwrap();
    fs::write(&file, &rollouts[..1000]).unwrap();
    run(folder.path(), RESUME, 0);
    assert!(fs::read(&file).unwrap() == rollouts);
    // As if the program had been killed before it joined them, on a disk that lost the end of a file.
    fs::remove_file(&file).unwrap();
    fs::create_dir(out.join("parts")).unwrap();
    fs::write(&part, &rollouts[..1000]).unwrap();
    run(folder.path(), RESUME, 0);
    assert!(fs::read(&file).unwrap() == rollouts);
    for (name, mend) in
        [("summary.json", "continuing the run writes it again"), ("provenance.json", "delete the folder")]
    {
        let path = out.join(name);
        fs::write(&path, &fs::read(&path).unwrap()[..100]).unwrap();
        let (_, refused) = said(&["report", text(&out)], 2);
        assert!(refused.contains(mend), "{refused}");
        // Without it, the next file is looked at.
        fs::remove_file(path).unwrap();
    }
}
