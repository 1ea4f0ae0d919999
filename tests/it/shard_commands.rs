//! Studies, curations, generated scenarios and realism metrics in units are those of one machine.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::program::reactsim;
use crate::reference::{said, text};
use crate::small_scenarios::{scenario, write};

/// Returns all files below a folder, by their paths in it.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = PathBuf::from(path.file_name().unwrap());
        match path.is_dir() {
            true => files.extend(tree(&path).into_iter().map(|(at, bytes)| (name.join(at), bytes))),
            false => drop(files.insert(name, fs::read(path).unwrap())),
        }
    }
    files
}

/// A command, and the name of its results in a folder of their own.
struct Divided<'a> {
    home: &'a Path,
    command: &'a [&'a str],
    out: &'a str,
}

impl Divided<'_> {
    fn arguments(&self, folder: &str) -> (PathBuf, Vec<String>) {
        let folder = self.home.join(folder);
        fs::create_dir_all(&folder).unwrap();
        let out = folder.join(self.out);
        let command = self.command.iter().map(|argument| (*argument).to_owned());
        (folder, command.chain(["--out".to_owned(), text(&out).to_owned()]).collect())
    }

    /// Plans units of this size, and returns their folder and that of the results.
    fn plan(&self, unit: &str) -> (String, PathBuf) {
        let units = text(&self.home.join(format!("units-of-{unit}"))).to_owned();
        let (folder, arguments) = self.arguments(&format!("merged-of-{unit}"));
        let mut plan = vec!["shard", "plan", &units, "--estimate", "0", "--unit", unit];
        plan.extend(arguments.iter().map(String::as_str));
        said(&plan, 0);
        (units, folder)
    }

    /// Compares units of these sizes with the command on one machine: all files, standard output, and exit
    /// code.
    fn is_the_same(&self, sizes: &[&str]) {
        let (whole, arguments) = self.arguments("whole");
        let one = reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(matches!(one.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&one.stderr));
        for size in sizes {
            let (units, merged) = self.plan(size);
            // One unit by itself; it stays as it is.
            assert!(matches!(
                reactsim(&["shard", "run", &units, "0", "--jobs", "1"]).status.code(),
                Some(0 | 1)
            ));
            let rest = reactsim(&["shard", "run", &units, "--missing"]);
            assert!(matches!(rest.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&rest.stderr));
            let done = reactsim(&["shard", "merge", &units]);
            let messages = String::from_utf8_lossy(&done.stderr).into_owned();
            assert_eq!(done.status.code(), one.status.code(), "{messages}");
            assert_eq!(String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&one.stdout));
            let (whole, merged) = (tree(&whole), tree(&merged));
            assert_eq!(whole.keys().collect::<Vec<_>>(), merged.keys().collect::<Vec<_>>());
            for (name, bytes) in &whole {
                assert!(*bytes == merged[name], "{} differs for units of {size}", name.display());
            }
        }
    }
}

/// Writes two files of scenarios, the second of which has an id of the first one.
fn logs(home: &Path) -> [String; 2] {
    let [first, second] = ["first.parquet", "second.parquet"].map(|name| home.join(name));
    write(&first, (0..7).map(scenario));
    write(&second, (6..10).map(scenario));
    [first, second].map(|path| text(&path).to_owned())
}

#[test]
fn studies() {
    let home = tempfile::tempdir().unwrap();
    let [first, second] = logs(home.path());
    let common = [first.as_str(), &second, "--models", "constant-velocity,idm", "--keep-rollouts"];
    for (name, study) in [
        ("replan", vec!["study", "replan", "--intervals", "5,20"]),
        ("realism", vec!["study", "realism", "--rollouts", "2"]),
        ("guards", vec!["study", "guards"]),
    ] {
        let home = home.path().join(name);
        let command = [&study[..], &common].concat();
        Divided { home: &home, command: &command, out: "study" }.is_the_same(&["3", "100"]);
    }
}

#[test]
fn a_study_whose_merge_was_interrupted_is_continued() {
    let home = tempfile::tempdir().unwrap();
    let [first, _] = logs(home.path());
    let command = ["study", "replan", &first, "--intervals", "5,20", "--models", "stop"];
    let divided = Divided { home: home.path(), command: &command, out: "study" };
    let (units, merged) = divided.plan("4");
    said(&["shard", "run", &units, "--missing"], 0);
    said(&["shard", "merge", &units], 0);
    let finished = tree(&merged);
    let (_, refused) = said(&["shard", "merge", &units], 2);
    assert!(refused.contains("has the results of this plan already"), "{refused}");
    // As if it had ended within the second member.
    fs::remove_file(merged.join("study/study.md")).unwrap();
    fs::remove_file(merged.join("study/steps-20/summary.json")).unwrap();
    fs::remove_file(merged.join("study/steps-20/summary.md")).unwrap();
    said(&["shard", "merge", &units], 0);
    assert!(tree(&merged) == finished);
}

#[test]
fn curations() {
    let home = tempfile::tempdir().unwrap();
    let [first, second] = logs(home.path());
    // One that cannot be read, and scenarios with other roads and agents.
    let third = home.path().join("third.json");
    fs::write(&third, r#"{"format": "reactsim-scenario-v1"}"#).unwrap();
    let bundled = ["scenarios/mini/crossing.json", "scenarios/mini/merge.json"];
    let bundled = bundled.map(|file| text(&Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).to_owned());
    let bundled: Vec<&str> = bundled.iter().map(String::as_str).filter(|f| Path::new(f).exists()).collect();
    let inputs = [&[first.as_str(), &second, text(&third)], &bundled[..]].concat();
    for (name, options) in [
        ("all", vec!["--min-vehicles", "1"]),
        ("few", vec!["--without-scenes", "--limit", "3", "--candidates", "5", "--seed", "4"]),
    ] {
        let home = home.path().join(name);
        let command = [&["curate"], &inputs[..], &options].concat();
        Divided { home: &home, command: &command, out: "candidates.parquet" }.is_the_same(&["1", "3", "100"]);
    }
}

#[test]
fn generated_scenarios() {
    let home = tempfile::tempdir().unwrap();
    for (name, options, sizes) in [
        ("train", vec!["--preset", "train", "--count", "9", "--seed", "3"], vec!["2", "100"]),
        (
            "bench",
            vec!["--preset", "bench", "--count", "3", "--seed", "1", "--maps", "priority-t"],
            vec!["5"],
        ),
    ] {
        let home = home.path().join(name);
        let command = [&["generate"], &options[..]].concat();
        Divided { home: &home, command: &command, out: "logs.parquet" }.is_the_same(&sizes);
    }
}

#[test]
fn realism_metrics_of_a_run() {
    let home = tempfile::tempdir().unwrap();
    let [first, second] = logs(home.path());
    let run = text(&home.path().join("run")).to_owned();
    let simulated = ["run", &first, "--models", "constant-velocity,stop", "--rollouts", "3"];
    said(&[&simulated[..], &["--protocol", "realism", "--keep-rollouts", "--out", &run]].concat(), 0);
    // Logs of the second file have no rollouts, except for one.
    let scored = ["score", &run, "--wosac", "--scenarios", &first, "--scenarios", &second];
    let command = [&scored[..], &["--simulator", "stop", "--wosac-config", "2025,2023"]].concat();
    let divided = Divided { home: home.path(), command: &command, out: "scores" };
    divided.is_the_same(&["1", "4", "100"]);

    let (units, _) = divided.plan("5");
    write(Path::new(&second), (20..24).map(scenario));
    let (_, refused) = said(&["shard", "run", &units, "2"], 2);
    assert!(refused.contains("it would not be of the planned work: `logs[1].blake3`"), "{refused}");
    said(&["shard", "run", &units, "0"], 0);
}

#[test]
fn realism_metrics_of_a_submission() {
    let Some(recordings) = crate::shared("data/womd") else { return };
    let logs = text(&recordings.join("val/womd-val-00000-of-00002.tfrecord.zst")).to_owned();
    let home = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&home.path().join(name)).to_owned();
    let (run, archive, metadata) = (at("run"), at("cv.tar.gz"), at("cv.toml"));
    fs::write(&metadata, crate::wosac::METADATA).unwrap();
    let simulated = ["run", &logs, "--models", "constant-velocity", "--protocol", "realism", "--limit", "4"];
    let rest = ["--rollouts", "32", "--all-agents", "--keep-rollouts", "--out", &run];
    said(&[&simulated[..], &rest].concat(), 0);
    let export = ["export", "wosac", &run, "--scenarios", &logs, "--metadata", &metadata, "--out", &archive];
    assert_eq!(reactsim(&export).status.code(), Some(1), "scenarios are missing");
    let command = ["score", &archive, "--wosac", "--scenarios", &logs];
    Divided { home: home.path(), command: &command, out: "scores" }.is_the_same(&["1", "3", "100"]);
}

#[test]
fn commands_that_cannot_be_divided_are_named() {
    let home = tempfile::tempdir().unwrap();
    let units = text(&home.path().join("units")).to_owned();
    let refuses = |command: &[&str], reason: &str| {
        let (_, refused) = said(&[&["shard", "plan", &units], command].concat(), 2);
        assert!(refused.contains(reason), "{refused}");
        assert!(!Path::new(&units).exists());
    };
    refuses(&["list", "models"], "only run, study, curate, generate and score --wosac can be divided");
    refuses(&["curate", "stats", "x.parquet"], "`curate stats` cannot be divided into units");
    refuses(&["score", "x.json", "--out", "y"], "`score` can be divided into units with --wosac only");
    refuses(&["score", "x", "--wosac"], "give --out FOLDER for the scores");
    refuses(&["study", "replan", "--out", "x", "--resume"], "--resume has no effect on work in units");
    refuses(&["generate", "--preset", "train", "--count", "3", "--out", "x", "--density", "9"], "density 9");
}

#[test]
fn help_of_the_command_to_divide_is_printed() {
    let help = reactsim(&["shard", "plan", "units", "run", "--help"]);
    assert_eq!(help.status.code(), Some(0), "{}", String::from_utf8_lossy(&help.stderr));
    assert!(String::from_utf8_lossy(&help.stdout).contains("Usage: reactsim run"));
}
