//! Runs in units: the merged folder is that of one machine, and faults are named.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;

use crate::program::{program, reactsim};
use crate::small_scenarios::{scenario, write};

/// Scenarios in two files, the second of which has an id of the first one and a damaged record.
struct Run {
    home: tempfile::TempDir,
    arguments: Vec<String>,
}

impl Run {
    fn new(scenarios: usize, models: &str) -> Self {
        let home = tempfile::tempdir().unwrap();
        let [first, second] = ["first.parquet", "second.parquet"].map(|name| home.path().join(name));
        write(&first, (0..scenarios).map(scenario));
        write(&second, (scenarios - 1..scenarios + 5).map(scenario));
        let inputs = [first, second].map(|p| p.to_str().unwrap().to_owned());
        let options = ["--models", models, "--keep-rollouts", "--rollouts", "2"].map(str::to_owned);
        let arguments = std::iter::once("run".to_owned()).chain(inputs).chain(options).collect();
        Self { home, arguments }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    /// Runs everything at once.
    fn whole(&self) -> PathBuf {
        let out = self.path("whole");
        let mut arguments: Vec<&str> = self.arguments.iter().map(String::as_str).collect();
        arguments.extend(["--out", out.to_str().unwrap()]);
        let done = reactsim(&arguments);
        assert!(matches!(done.status.code(), Some(0 | 1)), "{}", stderr(&done));
        out
    }

    /// Plans units of this many records.
    fn plan(&self, name: &str, unit: usize, options: &[&str]) -> Shards {
        let (folder, out) = (self.path(name), self.path(&format!("{name}-merged")));
        let mut arguments = vec!["shard", "plan", folder.to_str().unwrap(), "--estimate", "0", "--unit"];
        let unit = unit.to_string();
        arguments.push(&unit);
        arguments.extend(self.arguments.iter().map(String::as_str));
        arguments.extend(options);
        arguments.extend(["--out", out.to_str().unwrap()]);
        let done = reactsim(&arguments);
        assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
        Shards { folder, out }
    }
}

/// A folder of units, and the folder of their merged results.
struct Shards {
    folder: PathBuf,
    out: PathBuf,
}

impl Shards {
    fn command(&self, verb: &str, rest: &[&str]) -> Output {
        let folder = self.folder.to_str().unwrap();
        reactsim(&[&["shard", verb, folder], rest].concat())
    }

    fn run(&self, rest: &[&str]) {
        let done = self.command("run", rest);
        assert!(matches!(done.status.code(), Some(0 | 1)), "{}", stderr(&done));
    }

    fn merge(&self) {
        let done = self.command("merge", &[]);
        assert!(matches!(done.status.code(), Some(0 | 1)), "{}", stderr(&done));
    }

    fn refuses(&self, verb: &str, rest: &[&str], reason: &str) {
        let refused = self.command(verb, rest);
        assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
        assert!(stderr(&refused).contains(reason), "{}", stderr(&refused));
    }

    fn status(&self) -> Value {
        let status = self.command("status", &[]);
        serde_json::from_slice(&status.stdout).unwrap()
    }

    /// Returns the folders whose names begin like this, by name.
    fn folders(&self, prefix: &str) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.folder).unwrap().map(|e| e.unwrap().path());
        let begins = |p: &PathBuf| p.file_name().unwrap().to_str().unwrap().starts_with(prefix);
        let mut found: Vec<PathBuf> = entries.filter(begins).collect();
        found.sort();
        found
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn content(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let file = |path: PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        (name, fs::read(path).unwrap())
    };
    fs::read_dir(folder).unwrap().map(|e| file(e.unwrap().path())).collect()
}

/// Compares all files of two run folders.
fn assert_same(whole: &Path, merged: &Path) {
    let (whole, merged) = (content(whole), content(merged));
    assert_eq!(whole.keys().collect::<Vec<_>>(), merged.keys().collect::<Vec<_>>());
    for (name, bytes) in &whole {
        assert!(*bytes == merged[name], "{name} differs");
    }
}

#[test]
fn merged_units_are_the_run_on_one_machine_byte_for_byte() {
    let run = Run::new(13, "log-replay,idm");
    let whole = run.whole();
    // The second file repeats an id, which is refused in both.
    let failures = fs::read_to_string(whole.join("failures.jsonl")).unwrap();
    assert_eq!(failures.lines().count(), 1, "{failures}");
    for unit in [1, 4, 100] {
        let shards = run.plan(&format!("units-of-{unit}"), unit, &[]);
        let status = shards.status();
        let units = 13_usize.div_ceil(unit) + 6_usize.div_ceil(unit);
        assert_eq!((status["units"].as_u64(), status["records"].as_u64()), (Some(units as u64), Some(19)));
        // The last unit first, by itself; others together.
        shards.run(&[&(units - 1).to_string(), "--jobs", "1"]);
        assert_eq!(shards.status()["finished"], 1);
        shards.run(&["--missing"]);
        shards.merge();
        assert_same(&whole, &shards.out);
        // Merging does not use units up, and a finished folder is not overwritten.
        shards.refuses("merge", &[], "has the results of this plan already");
        fs::remove_dir_all(&shards.out).unwrap();
        shards.merge();
        assert_same(&whole, &shards.out);
    }
}

#[test]
fn an_id_that_is_repeated_within_a_unit_keeps_its_first_scenario() {
    let run = Run::new(3, "constant-velocity,stop");
    write(Path::new(&run.arguments[1]), [0, 1, 1, 2, 0].map(scenario));
    let whole = run.whole();
    let failures = fs::read_to_string(whole.join("failures.jsonl")).unwrap();
    assert_eq!(failures.lines().count(), 3, "{failures}");
    for unit in [2, 3, 100] {
        let shards = run.plan(&format!("units-of-{unit}"), unit, &[]);
        shards.run(&["--missing"]);
        shards.merge();
        assert_same(&whole, &shards.out);
    }
}

#[test]
fn selections_and_files_of_deviations_are_merged() {
    let run = Run::new(9, "constant-velocity");
    let deviations = run.path("deviations.parquet");
    let curated = reactsim(&[
        "curate",
        &run.arguments[1],
        "--without-scenes",
        "--min-vehicles",
        "1",
        "--out",
        deviations.to_str().unwrap(),
    ]);
    assert!(matches!(curated.status.code(), Some(0 | 1)), "{}", stderr(&curated));
    for options in [
        vec!["--deviations", deviations.to_str().unwrap()],
        vec!["--id", "road-003", "--id", "road-008", "--id", "nobody", "--av", "log"],
        vec!["--category", "lateral"],
        vec!["--limit", "5"],
    ] {
        fs::remove_dir_all(run.path("whole")).ok();
        let whole = Run { home: tempfile::tempdir().unwrap(), arguments: run.arguments.clone() };
        let out = whole.path("whole");
        let mut arguments: Vec<&str> = run.arguments.iter().map(String::as_str).collect();
        arguments.extend(&options);
        arguments.extend(["--out", out.to_str().unwrap()]);
        let one = reactsim(&arguments);
        let shards = run.plan(&format!("units{}", options[0]), 4, &options);
        shards.run(&["--missing"]);
        let merged = shards.command("merge", &[]);
        assert_eq!(one.status.code(), merged.status.code(), "{}{}", stderr(&one), stderr(&merged));
        assert_same(&out, &shards.out);
    }
}

#[test]
fn units_survive_processes_that_are_killed() {
    let run = Run::new(60, "log-replay,idm");
    let whole = run.whole();
    let shards = run.plan("units", 3, &[]);
    let mut killed = 0;
    // Two processes at a time carry out all units; one or both are killed after a while.
    for round in 0..12 {
        let start = || {
            let mut command = program();
            command.args(["shard", "run", shards.folder.to_str().unwrap(), "--missing", "--jobs", "1"]);
            command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
        };
        let mut children = [start(), start()];
        sleep(Duration::from_millis(20 + 37 * round % 110));
        for child in &mut children[..1 + (round % 2) as usize] {
            killed += usize::from(child.try_wait().unwrap().is_none());
            child.kill().ok();
        }
        for child in &mut children {
            child.wait().unwrap();
        }
    }
    assert!(killed > 0, "all processes were faster");
    shards.run(&["--missing"]);
    assert_eq!(shards.status()["missing"], Value::Array(Vec::new()));
    shards.merge();
    assert_same(&whole, &shards.out);
    assert!(shards.folders("partial-").is_empty());
}

#[test]
fn a_merge_that_was_killed_is_repeated() {
    let run = Run::new(13, "log-replay,idm");
    let whole = run.whole();
    let shards = run.plan("units", 4, &[]);
    shards.run(&["--missing"]);
    for after in [5, 15, 30, 60] {
        let mut command = program();
        command.args(["shard", "merge", shards.folder.to_str().unwrap()]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        sleep(Duration::from_millis(after));
        child.kill().ok();
        child.wait().unwrap();
    }
    if !shards.out.join("summary.md").exists() {
        shards.merge();
    }
    // Of a process that was killed after its last file; it locks nothing any more.
    fs::remove_file(shards.out.join(".lock")).ok();
    assert_same(&whole, &shards.out);
}

#[test]
fn lost_foreign_damaged_and_repeated_units_are_named() {
    let run = Run::new(8, "constant-velocity");
    let shards = run.plan("units", 4, &[]);
    shards.refuses("merge", &[], "4 of 4 units are not finished, among them 0, 1, 2, 3");
    shards.refuses("run", &["4"], "there is no unit 4: the plan has 4, numbered from 0");
    shards.run(&["--missing"]);
    let unit = shards.folders("unit-").remove(1);
    let name = unit.file_name().unwrap().to_str().unwrap().to_owned();

    // Of another plan.
    let other = run.plan("other", 4, &["--seed", "1"]);
    other.run(&["1"]);
    let foreign = other.folders("unit-").remove(0);
    let moved = shards.folder.join(foreign.file_name().unwrap());
    fs::rename(&foreign, &moved).unwrap();
    shards.refuses("merge", &[], "has results of another plan; move it away");
    fs::remove_dir_all(&moved).unwrap();

    // There twice.
    let copy = shards.folder.join(format!("{name}-copy"));
    fs::create_dir(&copy).unwrap();
    fs::copy(unit.join("unit.json"), copy.join("unit.json")).unwrap();
    shards.refuses("merge", &[], "unit 1 is there twice");
    fs::remove_dir_all(&copy).unwrap();

    // Damaged: changed, cut, without its record.
    let results = unit.join("results");
    let rows = fs::read(results.join("rows.jsonl")).unwrap();
    fs::write(results.join("rows.jsonl"), &rows[..rows.len() / 2]).unwrap();
    shards.refuses("merge", &[], "rows.jsonl was changed since it was written; remove the folder");
    fs::write(results.join("rows.jsonl"), &rows).unwrap();
    fs::remove_file(results.join("events.jsonl")).unwrap();
    shards.refuses("merge", &[], "events.jsonl is missing");
    fs::remove_file(unit.join("unit.json")).unwrap();
    shards.refuses("merge", &[], "unit.json is missing");

    // Lost.
    fs::remove_dir_all(&unit).unwrap();
    shards.refuses("merge", &[], "1 of 4 units are not finished, among them 1");
    shards.run(&["1"]);
    shards.merge();
    assert_same(&run.whole(), &shards.out);
}

#[test]
fn inputs_and_plans_that_change_are_named() {
    let run = Run::new(8, "constant-velocity");
    let shards = run.plan("units", 4, &[]);
    shards.run(&["0"]);
    write(Path::new(&run.arguments[1]), (1..9).map(scenario));
    shards.refuses("run", &["1"], "unit 1: it would not be of the planned work: `inputs[0].blake3` is");
    // Units of the other file are not concerned, neither alone nor in the same process.
    shards.run(&["2"]);
    shards.refuses("run", &["--missing"], "unit 1: it would not be of the planned work");
    assert_eq!(shards.status()["missing"], serde_json::json!([1]));
    fs::write(shards.folder.join("plan.json"), "{}").unwrap();
    shards.refuses("status", &[], "is not a plan of this program");
    fs::remove_file(shards.folder.join("plan.json")).unwrap();
    shards.refuses("merge", &[], "`reactsim shard plan` writes it");
}

#[test]
fn plans_that_make_no_sense_are_refused() {
    let run = Run::new(3, "constant-velocity");
    let folder = run.path("units");
    let refuses = |arguments: &[&str], reason: &str| {
        let refused = reactsim(&[&["shard", "plan", folder.to_str().unwrap()], arguments].concat());
        assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
        assert!(stderr(&refused).contains(reason), "{}", stderr(&refused));
        assert!(!folder.exists());
    };
    let input = run.arguments[1].as_str();
    refuses(&["run", input], "give --out FOLDER for the results");
    refuses(&["run", input, "--out", "x", "--resume"], "--resume has no effect on work in units");
    refuses(&["--unit", "0", "run", input, "--out", "x"], "0");
    let shards = run.plan("units", 2, &[]);
    shards.run(&["0"]);
    let again = reactsim(&["shard", "plan", folder.to_str().unwrap(), "run", input, "--out", "x"]);
    assert_eq!(again.status.code(), Some(2));
    assert!(stderr(&again).contains("exists; choose another folder"), "{}", stderr(&again));
}

/// A limit on the size of files stands for a disk that is full.
#[cfg(unix)]
#[test]
fn a_full_disk_is_named_and_loses_nothing() {
    let run = Run::new(24, "log-replay,idm");
    let whole = run.whole();
    let shards = run.plan("units", 12, &[]);
    shards.run(&["0"]);
    let limited = |verb: &str, blocks: usize| {
        let program = program();
        let (program, folder) = (program.get_program().to_str().unwrap().to_owned(), shards.folder.display());
        let rest = if verb == "run" { "--missing" } else { "" };
        let script = format!(
            "trap '' XFSZ; ulimit -f {blocks}; exec {program} shard {verb} {folder} {rest} >/dev/null"
        );
        let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains("could not write"), "{}", stderr(&output));
    };
    limited("run", 16);
    assert_eq!(shards.status()["finished"], 1);
    assert!(shards.folders("partial-").is_empty());
    shards.run(&["--missing"]);
    limited("merge", 16);
    shards.merge();
    assert_same(&whole, &shards.out);
}

#[test]
fn an_estimate_is_made_before_and_compared_after() {
    let run = Run::new(20, "idm");
    let (folder, out) = (run.path("units"), run.path("merged"));
    let mut arguments = vec!["shard", "plan", folder.to_str().unwrap(), "--unit", "5"];
    arguments.extend(run.arguments.iter().map(String::as_str));
    arguments.extend(["--out", out.to_str().unwrap()]);
    let planned = reactsim(&arguments);
    assert!(stderr(&planned).contains("estimate from 26 records: "), "{}", stderr(&planned));
    let shards = Shards { folder, out };
    assert!(shards.folders("partial-").is_empty());
    shards.run(&["--missing"]);
    let merged = shards.command("merge", &[]);
    assert!(stderr(&merged).contains("core-seconds used, "), "{}", stderr(&merged));
}
