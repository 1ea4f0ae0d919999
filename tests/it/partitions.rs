//! Commands in partitions: the merged output is that of the whole command, and faults are named.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use crate::program::{program, reactsim, said, text, words};
use crate::small_scenarios::{deviations, scenario, write};

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
    /// Runs the command with more arguments.
    fn run(&self, further: &[&str], out: &Path) {
        let arguments = [self.command, further, &["--out", text(out)]].concat();
        let done = reactsim(&arguments);
        assert!(matches!(done.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&done.stderr));
    }

    /// Runs partitions and returns their folders.
    fn partitions(&self, count: usize) -> Vec<String> {
        let one = |number| {
            let partition = format!("{number}/{count}");
            let folder = self.home.join(format!("part-{number}-of-{count}"));
            self.run(&["--partition", &partition, "--jobs", "1"], &folder);
            text(&folder).to_owned()
        };
        // The last one first: their order has no influence.
        (1..=count).rev().map(one).collect()
    }

    /// Compares these numbers of partitions with the whole command: all files, standard output, exit code.
    fn is_the_same(&self, counts: &[usize]) {
        let whole = self.home.join("whole");
        fs::create_dir_all(&whole).unwrap();
        let one = reactsim(&[self.command, &["--out", text(&whole.join(self.out))]].concat());
        assert!(matches!(one.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&one.stderr));
        let whole = tree(&whole);
        for &count in counts {
            let (folders, merged) = (self.partitions(count), self.home.join(format!("merged-of-{count}")));
            fs::create_dir_all(&merged).unwrap();
            let out = merged.join(self.out);
            let folders: Vec<&str> = folders.iter().map(String::as_str).collect();
            let done = reactsim(&[&["merge"], &folders[..], &["--out", text(&out)]].concat());
            let messages = String::from_utf8_lossy(&done.stderr).into_owned();
            assert_eq!(done.status.code(), one.status.code(), "{messages}");
            assert_eq!(String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&one.stdout));
            let merged = tree(&merged);
            assert_eq!(whole.keys().collect::<Vec<_>>(), merged.keys().collect::<Vec<_>>());
            for (name, bytes) in &whole {
                assert!(*bytes == merged[name], "{} differs for {count} partitions", name.display());
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
fn runs() {
    let home = tempfile::tempdir().unwrap();
    let [first, second] = logs(home.path());
    // Ids that are repeated within a partition and across them, and a file that cannot be read.
    let (third, fourth) = (home.path().join("third.parquet"), home.path().join("fourth.json"));
    write(&third, [0, 20, 20, 21, 0].map(scenario));
    fs::write(&fourth, r#"{"format": "reactsim-scenario-v1"}"#).unwrap();
    let models = ["--models", "log-replay,idm", "--keep-rollouts", "--rollouts", "2"];
    let command = [&["run", &first, &second, text(&third), text(&fourth)], &models[..]].concat();
    // Whole files, records, and more partitions than records.
    Divided { home: home.path(), command: &command, out: "run" }.is_the_same(&[1, 2, 5, 20]);
}

#[test]
fn selections_and_files_of_deviations() {
    let home = tempfile::tempdir().unwrap();
    let [first, second] = logs(home.path());
    // Of the first partition of three all scenarios have one, of the last none; one has no scenario.
    let file = home.path().join("deviations.json");
    fs::write(&file, deviations(&[0, 1, 2, 3, 5, 20]).to_string()).unwrap();
    for (name, options) in [
        ("deviations", vec!["--deviations", text(&file)]),
        ("ids", vec!["--id", "road-003", "--id", "road-008", "--id", "nobody", "--av", "log"]),
        ("category", vec!["--category", "lateral"]),
        ("limit", vec!["--limit", "5"]),
    ] {
        let command = [&["run", &first, &second, "--models", "constant-velocity"], &options[..]].concat();
        let home = home.path().join(name);
        Divided { home: &home, command: &command, out: "run" }.is_the_same(&[3]);
    }
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
        Divided { home: &home, command: &command, out: "study" }.is_the_same(&[2, 4]);
    }
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
        Divided { home: &home, command: &command, out: "candidates.parquet" }.is_the_same(&[2, 6, 15]);
    }
}

#[test]
fn generated_scenarios() {
    let home = tempfile::tempdir().unwrap();
    for (name, options, counts) in [
        ("train", vec!["--preset", "train", "--count", "9", "--seed", "3"], vec![2, 12]),
        ("bench", vec!["--preset", "bench", "--count", "3", "--seed", "1", "--maps", "priority-t"], vec![3]),
    ] {
        let home = home.path().join(name);
        let command = [&["generate"], &options[..]].concat();
        Divided { home: &home, command: &command, out: "logs.parquet" }.is_the_same(&counts);
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
    let options = ["--simulator", "stop", "--wosac-config", "2025,2023", "--format", "json"];
    let command = [&scored[..], &options].concat();
    Divided { home: home.path(), command: &command, out: "scores" }.is_the_same(&[1, 2, 4]);
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
    Divided { home: home.path(), command: &command, out: "scores" }.is_the_same(&[1, 3]);
}

#[test]
fn a_partition_that_was_killed_is_resumed() {
    let home = tempfile::tempdir().unwrap();
    let input = home.path().join("logs.parquet");
    write(&input, (0..60).map(scenario));
    let command = ["run", text(&input), "--models", "log-replay,idm"];
    let divided = Divided { home: home.path(), command: &command, out: "run" };
    let folder = home.path().join("part-2-of-2");
    let resumed = ["--partition", "2/2", "--jobs", "1", "--resume", "--out", text(&folder)];
    for round in 0..6 {
        let mut command = program();
        command.args(divided.command).args(resumed).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        sleep(Duration::from_millis(20 + 37 * round));
        child.kill().ok();
        child.wait().unwrap();
    }
    said(&[&command[..], &resumed].concat(), 0);
    let first = home.path().join("part-1-of-2");
    divided.run(&["--partition", "1/2"], &first);
    let (whole, merged) = (home.path().join("whole"), home.path().join("merged"));
    divided.run(&[], &whole);
    said(&["merge", text(&first), text(&folder), "--out", text(&merged)], 0);
    fs::remove_file(folder.join(".lock")).ok();
    assert!(tree(&whole) == tree(&merged));
}

#[test]
fn lost_foreign_damaged_and_repeated_partitions_are_named() {
    let home = tempfile::tempdir().unwrap();
    let [first, second] = logs(home.path());
    let command = ["run", &first, &second, "--models", "constant-velocity"];
    let divided = Divided { home: home.path(), command: &command, out: "run" };
    let folders = divided.partitions(3);
    let [three, two, one] = [0, 1, 2].map(|i| folders[i].as_str());
    let out = home.path().join("out");
    let refuses = |folders: &[&str], reason: &str| {
        let (_, refused) = said(&[&["merge"], folders, &["--out", text(&out)]].concat(), 2);
        assert!(refused.contains(reason), "{refused}");
        assert!(!out.exists());
    };
    refuses(&[one, three], "1 partition of 3 missing, among them 2");
    refuses(&[one, two, three, two], "partition 2/3 is there twice");
    refuses(&[one, two, text(home.path())], "has no finished partition: run it with --partition");
    let of_two = home.path().join("of-two");
    divided.run(&["--partition", "1/2"], &of_two);
    refuses(&[one, text(&of_two)], "has partition 1/2");
    let foreign = home.path().join("foreign");
    divided.run(&["--partition", "2/3", "--seed", "1"], &foreign);
    refuses(&[one, text(&foreign), three], "`seed` is 1 in the former and 0 in the latter");
    let rows = Path::new(two).join("rows.jsonl");
    let all = fs::read_to_string(&rows).unwrap();
    fs::write(&rows, all.split_inclusive('\n').skip(2).collect::<String>()).unwrap();
    refuses(&[one, two, three], "has fewer scenarios than summary.json; run the partition again");
    fs::write(&rows, &all[..all.len() / 2]).unwrap();
    refuses(&[one, two, three], "rows.jsonl");
    fs::write(&rows, &all).unwrap();
    // Another content of a file that both partitions read.
    fs::remove_dir_all(two).unwrap();
    write(Path::new(&first), (30..37).map(scenario));
    divided.run(&["--partition", "2/3"], Path::new(two));
    refuses(&[one, two, three], "`inputs[0].blake3` is");
    let path = Path::new(three).join("partition.json");
    fs::write(&path, "{}").unwrap();
    refuses(&[one, two, three], "partition.json is damaged");
}

#[test]
fn partitions_that_make_no_sense_are_refused() {
    let home = tempfile::tempdir().unwrap();
    let [input, _] = logs(home.path());
    let out = text(&home.path().join("out")).to_owned();
    let refuses = |arguments: &[&str], reason: &str| {
        let (_, refused) = said(arguments, 2);
        assert!(refused.contains(reason), "{refused}");
        assert!(!Path::new(&out).exists());
    };
    refuses(&["run", &input, "--partition", "1/2"], "--out");
    refuses(&["run", &input, "--partition", "3/2", "--out", &out], "expected I/N");
    refuses(&["score", "x.json", "--partition", "1/2", "--out", &out], "--partition goes with --wosac only");
    let dense = format!("generate --preset train --count 3 --density 9 --partition 1/2 --out {out}");
    refuses(&words(&dense), "density 9");
}
