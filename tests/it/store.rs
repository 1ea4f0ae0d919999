//! Scenarios behind URLs: the same results as from files, and no fault of the helper stalls or falsifies a
//! run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::program::program;
use crate::small_scenarios::{deviations, scenario, write};

const FAKE: &str = include_str!("store/fake.py");
/// Files of a run that must not depend on where its scenarios are.
const RESULTS: [&str; 6] =
    ["summary.json", "rows.jsonl", "events.jsonl", "failures.jsonl", "summary.md", "provenance.json"];

/// A folder `data` with scenarios of several formats, and the fake helper.
struct Fake {
    home: tempfile::TempDir,
}

impl Fake {
    /// Writes the files. `None`, with a message, if there is no Python.
    fn new() -> Option<Self> {
        if !Command::new("python3").arg("--version").output().is_ok_and(|o| o.status.success()) {
            crate::skipped("there is no python3");
            return None;
        }
        let fake = Self { home: tempfile::tempdir().unwrap() };
        fs::create_dir_all(fake.path("data/inner/.hidden")).unwrap();
        fs::write(fake.path("fake.py"), FAKE).unwrap();
        let mini = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/mini");
        for (name, target) in
            [("crossing.json", "data/crossing.json"), ("crossing.json", "data/inner/.x.json")]
        {
            fs::copy(mini.join(name), fake.path(target)).unwrap();
        }
        write(&fake.path("data/inner/b.parquet"), (0..20).map(scenario));
        write(&fake.path("data/inner/.hidden/c.parquet"), (20..24).map(scenario));
        fs::write(fake.path("data/readme.txt"), "no scenario").unwrap();
        fs::write(fake.path("data/broken.json"), "{}").unwrap();
        Some(fake)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    fn command(&self, fault: &str, arguments: &[&str]) -> Command {
        let mut command = program();
        command.args(arguments).current_dir(self.home.path());
        command.env("REACTSIM_STORE", "python3 fake.py").env("REACTSIM_STORE_TIMEOUT", "2");
        command.env("FAKE_ROOT", self.home.path()).env("FAKE_FAULT", fault);
        command.env("FAKE_LOG", self.path("requests"));
        command
    }

    fn run(&self, fault: &str, arguments: &[&str]) -> Output {
        self.command(fault, arguments).output().unwrap()
    }

    /// Runs the baselines on these scenarios, and returns the output and the run folder.
    fn scenarios(&self, fault: &str, scenarios: &str, out: &str) -> (Output, PathBuf) {
        let done = self.run(fault, &["run", scenarios, "--models", "log-replay,stop", "--out", out]);
        (done, self.path(out))
    }

    fn requests(&self) -> String {
        fs::read_to_string(self.path("requests")).unwrap_or_default()
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn assert_equal(first: &Path, second: &Path) {
    for name in RESULTS {
        assert!(
            fs::read(first.join(name)).unwrap() == fs::read(second.join(name)).unwrap(),
            "{name} differs"
        );
    }
}

#[test]
fn a_folder_behind_a_url_gives_the_results_of_the_folder() {
    let Some(fake) = Fake::new() else { return };
    let (local, expected) = fake.scenarios("", "data", "local");
    assert_eq!(local.status.code(), Some(0), "{}", stderr(&local));
    for (fault, url) in [("", "fake://data"), ("reordered", "fake://data/")] {
        let (remote, found) = fake.scenarios(fault, url, "remote");
        assert_eq!(remote.status.code(), Some(0), "{}", stderr(&remote));
        assert_equal(&expected, &found);
        assert_eq!(stderr(&local), stderr(&remote).replace("fake://", ""));
        fs::remove_dir_all(found).unwrap();
    }
    let provenance = fs::read_to_string(expected.join("provenance.json")).unwrap();
    assert!(provenance.contains("\"name\": \"c.parquet\"") && !provenance.contains("fake:"));
    assert!(!fake.requests().contains(".x.json\t0"), "hidden files are not read");
}

#[test]
fn other_commands_read_urls_too() {
    let Some(fake) = Fake::new() else { return };
    let file = "data/inner/b.parquet";
    let inspect = |path: &str| fake.run("", &["inspect", path]);
    let (local, remote) = (inspect(file), inspect(&format!("fake://{file}")));
    assert!(local.status.success() && local.stdout == remote.stdout, "{}", stderr(&remote));

    for (source, out) in [("data/inner", "one.parquet"), ("fake://data/inner", "two.parquet")] {
        let done = fake.run("", &["convert", source, "--out", out]);
        assert!(done.status.success(), "{}", stderr(&done));
    }
    assert!(fs::read(fake.path("one.parquet")).unwrap() == fs::read(fake.path("two.parquet")).unwrap());

    let url = "fake://one.parquet";
    for (source, out) in [("one.parquet", "av1"), (url, "av2")] {
        let done = fake.run("", &["curate", source, "--out", &format!("{out}.parquet")]);
        assert!(done.status.success(), "{}", stderr(&done));
    }
    assert!(fs::read(fake.path("av1.parquet")).unwrap() == fs::read(fake.path("av2.parquet")).unwrap());

    fs::write(fake.path("av.json"), deviations(&[3, 22]).to_string()).unwrap();
    for (file, out) in [("av.json", "run1"), ("fake://av.json", "run2")] {
        let options = ["--deviations", file, "--models", "stop", "--out", out];
        let done = fake.run("", &[&["run", url][..], &options].concat());
        assert!(done.status.success(), "{}", stderr(&done));
    }
    assert_equal(&fake.path("run1"), &fake.path("run2"));
}

#[test]
fn units_of_urls_merge_to_the_same_run() {
    let Some(fake) = Fake::new() else { return };
    let (_, expected) = fake.scenarios("", "data", "whole");
    let plan = ["shard", "plan", "units", "--unit", "3", "run", "fake://data", "--models", "log-replay,stop"];
    for arguments in [
        &[&plan[..], &["--out", "merged"]].concat()[..],
        &["shard", "run", "units", "--missing"],
        &["shard", "merge", "units"],
    ] {
        let done = fake.run("", arguments);
        assert!(done.status.success(), "{}", stderr(&done));
    }
    assert_equal(&expected, &fake.path("merged"));
}

#[test]
fn a_run_survives_a_helper_that_ends() {
    let Some(fake) = Fake::new() else { return };
    let (_, expected) = fake.scenarios("", "data", "local");
    // Every helper answers five requests and ends at the sixth one; the next helper is asked again.
    for fault in ["die:5", "garbage:5", "cut:5"] {
        let (done, found) = fake.scenarios(fault, "fake://data", "remote");
        assert_eq!(done.status.code(), Some(0), "{fault}: {}", stderr(&done));
        assert_equal(&expected, &found);
        fs::remove_dir_all(found).unwrap();
    }
}

#[test]
fn faults_of_the_helper_are_named() {
    let Some(fake) = Fake::new() else { return };
    for (fault, parts) in [
        ("die", &["fake.py`: it ended (out of memory", "copy the file"][..]),
        ("garbage", &["it answers `<html>500</html>`, which is not of its protocol"]),
        ("cut", &["it ended"]),
        ("stall", &["there was no answer within 2 s", "REACTSIM_STORE_TIMEOUT"]),
        ("silent", &["it did not begin within 2 s", "REACTSIM_STORE"]),
        ("greeting", &["it begins with `hello`"]),
        ("no-package", &["it ended (No module named reactsim)", "pip install 'reactsim[store]'"]),
        ("changed:1", &["could not read: it was changed; start again"]),
        ("short:1", &["bytes from byte 0 on", "changed while it was read"]),
    ] {
        let (done, _) = fake.scenarios(fault, "fake://data/inner/b.parquet", "remote");
        assert_eq!(done.status.code(), Some(2), "{fault}: {}", stderr(&done));
        for part in [&["fake://data/inner/b.parquet"], parts].concat() {
            assert!(stderr(&done).contains(part), "{fault}: {part} is not in {}", stderr(&done));
        }
    }
    let mut command = fake.command("", &["inspect", "fake://data/crossing.json"]);
    let done = command.env("REACTSIM_STORE", "/nowhere/python -m x").output().unwrap();
    assert!(stderr(&done).contains("helper `/nowhere/python -m x` cannot be used: No such file"));
}

#[test]
fn files_that_cannot_be_read_are_named_and_the_others_run() {
    let Some(fake) = Fake::new() else { return };
    for (url, part) in [
        ("fake://data/none.parquet", "could not read: there is no such file; check the URL"),
        ("fake://denied/a.parquet", "could not read: no permission for you; ask"),
        ("fake://data/readme.txt", "is a file of an unknown kind, not a scenario file"),
        ("fake://da\tta", "control characters"),
    ] {
        let (done, _) = fake.scenarios("", url, "remote");
        assert_eq!(done.status.code(), Some(2));
        assert!(stderr(&done).contains(part), "{url}: {}", stderr(&done));
    }
    fs::copy(fake.path("data/crossing.json"), fake.path("data/denied.json")).unwrap();
    let (done, found) = fake.scenarios("", "fake://data", "remote");
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let warning = "fake://data/denied.json is skipped: it cannot be read: no permission";
    assert!(stderr(&done).contains(warning), "{}", stderr(&done));
    assert!(found.join("summary.json").exists());
}

#[test]
fn formats_of_several_files_are_refused() {
    let Some(fake) = Fake::new() else { return };
    fs::write(fake.path("data/log.db"), "SQLite format 3\0").unwrap();
    let (done, _) = fake.scenarios("", "fake://data/log.db", "remote");
    let part =
        "fake://data/log.db: is of the format nuplan, which is read from several files of a file system";
    assert_eq!(done.status.code(), Some(2));
    assert!(stderr(&done).contains(part), "{}", stderr(&done));
    let (done, _) = fake.scenarios("", "fake://data", "remote");
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert!(stderr(&done).contains("log.db is skipped: it is of the format nuplan"), "{}", stderr(&done));
}

#[test]
fn results_are_not_written_to_urls() {
    let Some(fake) = Fake::new() else { return };
    for out in ["s3://bucket/run", "memory://run"] {
        let (done, _) = fake.scenarios("", "data", out);
        assert_eq!(done.status.code(), Some(2));
        assert!(stderr(&done).contains("--out is the URL"), "{}", stderr(&done));
    }
    assert!(!fake.path("s3:").exists() && !fake.path("memory:").exists());
}

#[test]
fn a_large_file_takes_few_requests() {
    let Some(fake) = Fake::new() else { return };
    write(&fake.path("large.parquet"), (0..400).map(scenario));
    let size = fs::metadata(fake.path("large.parquet")).unwrap().len();
    let (done, _) = fake.scenarios("", "fake://large.parquet", "remote");
    assert!(done.status.success(), "{}", stderr(&done));
    let requests = fake.requests();
    // The file is read twice, for its digest and for its scenarios, in blocks of up to 8 MiB.
    let most = 2 * (size / (8 << 20) + 6) as usize;
    assert!(requests.lines().count() <= most, "{size} bytes: {requests}");
    assert_eq!(requests.lines().filter(|line| line.contains("\tlist\t")).count(), 1);
}
