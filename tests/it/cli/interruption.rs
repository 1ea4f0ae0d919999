//! Runs that are killed or interrupted, and their folders.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::{results, stderr, text};
use crate::program::{program, reactsim};
use crate::small_scenarios::{scenario, write};

/// Finishes a run of two scenarios that keeps its rollouts, and returns the arguments that resume it.
fn finished(folder: &Path) -> Vec<String> {
    let out = folder.join("run");
    let scenarios = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
    let run = ["run", scenarios, "--limit", "2", "--models", "constant-velocity,stop", "--keep-rollouts"];
    let mut arguments: Vec<String> = run.iter().map(|a| (*a).to_owned()).collect();
    arguments.extend(["--out".to_owned(), text(&out).to_owned()]);
    let done = reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    arguments.push("--resume".to_owned());
    arguments
}

#[test]
fn a_run_killed_while_it_removes_its_parts_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = finished(folder.path());
    let run = folder.path().join("run");
    let rollouts = fs::read(run.join("rollouts.parquet")).unwrap();
    fs::create_dir(run.join("parts")).unwrap();
    fs::copy(run.join("rollouts.parquet"), run.join("parts/000000-00000001-000.parquet")).unwrap();
    let resumed = reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert!(!run.join("parts").exists());
    assert!(fs::read(run.join("rollouts.parquet")).unwrap() == rollouts);
}

#[test]
fn lost_events_are_counted_again_and_damaged_ones_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = finished(folder.path());
    let resume = || reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let path = folder.path().join("run/events.jsonl");
    let events = fs::read_to_string(&path).unwrap();
    assert!(events.contains("\"metric\":\"aav-collision\""), "{events}");
    fs::write(&path, "").unwrap();
    let resumed = resume();
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert_eq!(fs::read_to_string(&path).unwrap(), events);
    fs::write(&path, events.replacen("\"input\"", "\"inp", 1)).unwrap();
    let refused = resume();
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("events.jsonl is damaged in line 1"), "{}", stderr(&refused));
}

/// Starts a run that lasts for seconds and waits until it has written rows.
fn long_run(input: &Path, out: &Path, resume: bool) -> Child {
    let mut command = program();
    command.args(["run", text(input), "--models", "log-replay,stop", "--rollouts", "30", "--jobs", "1"]);
    command.args(["--batch", "1", "--out", text(out)]).args(resume.then_some("--resume"));
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    while fs::metadata(out.join("rows.jsonl")).map_or(0, |m| m.len()) == 0 {
        assert!(child.try_wait().unwrap().is_none(), "the run ended before it wrote a row");
        assert!(begun.elapsed() < Duration::from_secs(60), "no row was written");
        sleep(Duration::from_millis(2));
    }
    child
}

/// Sends a signal to a run in progress; if the run ended before, tries again.
#[cfg(unix)]
fn signalled(input: &Path, out: &Path, signal: &str) -> Output {
    for _ in 0..20 {
        let child = long_run(input, out, false);
        Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        let output = child.wait_with_output().unwrap();
        if !out.join("summary.json").exists() {
            return output;
        }
        fs::remove_dir_all(out).unwrap();
    }
    panic!("no run lasted long enough for {signal}");
}

#[cfg(unix)]
#[test]
fn killed_and_interrupted_runs_go_on_to_the_same_bytes() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("scenarios.parquet");
    write(&input, (0..24).map(scenario));
    let folder = |name: &str| home.path().join(name);
    let whole = folder("whole");
    assert!(long_run(&input, &whole, false).wait().unwrap().success());

    let killed = folder("killed");
    signalled(&input, &killed, "-KILL");
    assert!(long_run(&input, &killed, true).wait().unwrap().success());
    assert!(results(&killed) == results(&whole));

    // ^C.
    let stopped = folder("stopped");
    let output = signalled(&input, &stopped, "-INT");
    assert_eq!(output.status.code(), Some(130));
    assert!(stderr(&output).contains("--resume"), "{}", stderr(&output));
    let rows = fs::read_to_string(stopped.join("rows.jsonl")).unwrap();
    assert!(
        rows.ends_with('\n') && rows.lines().all(|l| serde_json::from_str::<serde_json::Value>(l).is_ok())
    );
    let unfinished = reactsim(&["report", text(&stopped)]);
    assert!(stderr(&unfinished).contains("holds no finished run"), "{}", stderr(&unfinished));
    assert!(long_run(&input, &stopped, true).wait().unwrap().success());
    assert!(results(&stopped) == results(&whole));
}

#[test]
fn a_reader_that_goes_away_is_no_error_but_a_full_disk_is() {
    let mut child = program().args(["list", "metrics"]).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
    let Ok(full) = fs::OpenOptions::new().write(true).open("/dev/full") else { return };
    let output = program().args(["list", "metrics"]).stdout(full).stderr(Stdio::piped()).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("could not write to stdout"));
}

#[test]
fn truncated_rollouts_are_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = finished(folder.path());
    let resume = || reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let run = folder.path().join("run");
    let (file, part) = (run.join("rollouts.parquet"), run.join("parts/000000-00000000-000.parquet"));
    let rollouts = fs::read(&file).unwrap();
    fs::write(&file, &rollouts[..1000]).unwrap();
    let resumed = resume();
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert!(fs::read(&file).unwrap() == rollouts);
    // As if the program had been killed before it joined them, on a disk that lost the end of a file.
    fs::remove_file(&file).unwrap();
    fs::create_dir(run.join("parts")).unwrap();
    fs::write(&part, &rollouts[..1000]).unwrap();
    let resumed = resume();
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert!(fs::read(&file).unwrap() == rollouts);
    for (name, mend) in
        [("summary.json", "--resume writes it again"), ("provenance.json", "delete the folder")]
    {
        let path = run.join(name);
        fs::write(&path, &fs::read(&path).unwrap()[..100]).unwrap();
        let refused = reactsim(&["report", text(&run)]);
        assert_eq!(refused.status.code(), Some(2));
        assert!(stderr(&refused).contains(mend), "{}", stderr(&refused));
        // Without it, the next file is looked at.
        fs::remove_file(path).unwrap();
    }
}
