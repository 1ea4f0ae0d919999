//! Runs that are killed when a certain file appears or disappears, and resumed: the same bytes as without the
//! kill.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::program::program;
use crate::small_scenarios::{scenario, write};

/// A moment of a run, as seen in its folder.
type Moment = fn(&Path) -> bool;

/// Moments from the beginning of a run to its end.
const MOMENTS: [(&str, Moment); 9] = [
    ("the folder", |run| run.exists()),
    ("the provenance", |run| run.join("provenance.json").exists()),
    ("the first row", |run| size(&run.join("rows.jsonl")) > 0),
    ("the fifth part", |run| fs::read_dir(run.join("parts")).is_ok_and(|parts| parts.count() >= 5)),
    ("sorted rows", |run| has_partial(run, ".rows.jsonl")),
    ("the table of values", |run| run.join("values.parquet").exists()),
    ("rollouts being joined", |run| has_partial(run, ".rollouts.parquet")),
    ("joined rollouts", |run| run.join("rollouts.parquet").exists()),
    ("the summary", |run| run.join("summary.json").exists()),
];

fn size(path: &Path) -> u64 {
    path.metadata().map_or(0, |metadata| metadata.len())
}

fn has_partial(run: &Path, begin: &str) -> bool {
    let names = fs::read_dir(run).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names.into_iter().any(|name| {
        let name = name.to_string_lossy();
        name.starts_with(begin) && name.ends_with(".partial")
    })
}

/// Starts a run, kills it a moment later than `moment`, and resumes it.
fn kill_and_resume(input: &Path, run: &Path, moment: Moment, later: Duration) {
    let command = |resume: bool| {
        let mut command = program();
        command.arg("run").arg(input).args(["--models", "stop,constant-velocity", "--rollouts", "2"]);
        command.args(["--keep-rollouts", "--quiet", "--out"]).arg(run);
        if resume {
            command.arg("--resume");
        }
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    let (mut child, start) = (command(false), Instant::now());
    while !moment(run) && child.try_wait().unwrap().is_none() && start.elapsed().as_secs() < 60 {
        std::hint::spin_loop();
    }
    sleep(later);
    child.kill().ok();
    child.wait().unwrap();
    assert!(command(true).wait().unwrap().success(), "cannot be resumed");
}

/// Kills runs at every moment, and `more` times a little later.
fn attack(more: u32) {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("scenarios.parquet");
    write(&input, (0..12).map(scenario));
    let whole = home.path().join("whole");
    kill_and_resume(&input, &whole, |_| false, Duration::ZERO);
    for (name, moment) in MOMENTS {
        for k in 0..=more {
            let run = home.path().join("killed");
            kill_and_resume(&input, &run, moment, Duration::from_micros(u64::from(k) * 700));
            for file in ["rows.jsonl", "events.jsonl", "failures.jsonl", "summary.json", "rollouts.parquet"] {
                let same = fs::read(run.join(file)).unwrap() == fs::read(whole.join(file)).unwrap();
                assert!(same, "{file} differs after a kill at {name}, {k}");
            }
            assert!(!run.join("parts").exists(), "parts stay after a kill at {name}, {k}");
            let left = fs::read_dir(&run).unwrap().map(|entry| entry.unwrap().file_name());
            let left: Vec<_> = left.filter(|file| file.to_string_lossy().starts_with('.')).collect();
            assert!(left.is_empty(), "{left:?} stays after a kill at {name}, {k}");
            fs::remove_dir_all(&run).unwrap();
        }
    }
}

#[test]
fn runs_killed_at_chosen_moments_can_be_resumed() {
    attack(0);
}

#[test]
#[ignore = "kills hundreds of runs"]
fn runs_killed_at_many_moments_can_be_resumed() {
    attack(40);
}
