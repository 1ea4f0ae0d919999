//! Import of ReactSim-Bench: a log and its files, written here.

use std::fs;
use std::path::Path;
use std::process::Output;

use reactsim::formats::deviations;
use reactsim_test_support::nuplan::{Fixture, ORIGIN, bench_name as name, hex, token};
use reactsim_test_support::pickle::{Py, archive, pickle};

use crate::program::reactsim;

/// Rows of the log that become current frames.
const ROWS: [u32; 6] = [22, 29, 36, 43, 50, 57];

/// Trajectory in the frame of the rear axle: the AV, which drives at 5 m/s in the log, turns to the left.
fn turning() -> Vec<f64> {
    let (mut x, mut y, mut heading) = (0.0_f64, 0.0_f64, 0.0_f64);
    let pose = |step: u32| {
        (x, y) = (x + 0.5 * (heading + 0.01).cos(), y + 0.5 * (heading + 0.01).sin());
        heading += if step < 20 { 0.02 } else { 0.0 };
        [x, y, heading]
    };
    (0..80).flat_map(pose).collect()
}

/// Trajectory from the position of the rear axle in a row of the log.
fn global(row: u32) -> Py {
    let from = [ORIGIN.0 - 40.0 + 0.25 * f64::from(row), ORIGIN.1, 0.0];
    Py::Array(vec![80, 3], turning().iter().enumerate().map(|(i, v)| v + from[i % 3]).collect())
}

struct Home {
    fixture: Fixture,
    folder: tempfile::TempDir,
}

impl Home {
    fn new() -> Self {
        let fixture = Fixture::write();
        Self { fixture, folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn put(&self, folder: &str, name: &str, content: &[u8]) {
        fs::create_dir_all(self.path(folder)).unwrap();
        fs::write(Path::new(&self.path(folder)).join(name), content).unwrap();
    }

    fn import(&self, folder: &str, more: &[&str]) -> Output {
        let (files, out, logs) =
            (self.path(folder), self.path("official.parquet"), self.fixture.log.to_str().unwrap());
        reactsim(&[&["import", "reactsim-bench", &files, "--nuplan", logs, "--out", &out], more].concat())
    }
}

fn texts(output: &Output) -> String {
    String::from_utf8_lossy(&[&output.stdout[..], &output.stderr[..]].concat()).into_owned()
}

#[test]
fn faults_are_counted_and_named_and_the_rest_is_imported() {
    let home = Home::new();
    let good = |row: u32| pickle(&global(row), 4, 2);
    for row in ROWS {
        home.put("data/lateral", &name(row), &good(row));
    }
    let scene = hex(token(b's', 2));
    let sample = |row: u32| hex(token(b'p', row));
    let other_scene = format!("town_{}_{}.pkl", hex(token(b's', 9)), sample(25));
    home.put("data/lateral", &other_scene, &good(25));
    home.put("data/lateral", &name(25), &good(25));
    home.put("data", &format!("town_{scene}_{}.pkl", sample(26)), &good(26)[..900]);
    let attack = Py::List(vec![global(27), Py::Call("posix", "system", "true")]);
    home.put("data", &format!("town_{scene}_{}.pkl", sample(27)), &pickle(&attack, 4, 2));
    home.put("data", &format!("town_{scene}_{}.pkl", sample(28)), &good(50));
    home.put("data", &format!("town_{scene}_{}.pkl", hex(token(b'q', 1))), &good(30));
    home.put("data", &format!("village_{scene}_{}.pkl", sample(31)), &good(31));
    home.put("data", &format!("town_{}_{}.pkl", hex(token(b's', 9)), hex(token(b'q', 2))), &good(32));
    home.put("data", &format!("town_{scene}_{}.pkl", sample(200)), &good(33));
    home.put("data/zcopy", &name(22), &good(22));
    home.put("data/other", &name(29), &pickle(&global(29), 2, 1));
    home.put("data", "readme.pkl", b"");
    let list = format!("file,category\n{},longitudinal\n", name(57));
    home.put("data", "list.csv", list.as_bytes());
    let output = home.import("data", &[]);
    let text = texts(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("7 of 18 files: 80 × 3"), "{text}");
    assert!(text.contains("1 longitudinal, 6 lateral, 0 directional (as the files, their lists"), "{text}");
    let refused = fs::read_to_string(home.path("official.refused.tsv")).unwrap();
    for (file, reason) in [
        (sample(25), "no log of --nuplan has the scene"),
        (sample(26), "the file is cut"),
        (sample(27), "it tries to run code: it calls `posix.system`"),
        (sample(28), "does not continue the logged AV"),
        (hex(token(b'q', 1)), "has no frame with the token"),
        (sample(31), "the name states the map village"),
        (hex(token(b'q', 2)), "no log of --nuplan has the scene"),
        (sample(200), "rows before and 20 after"),
        ("zcopy".to_owned(), "the same file as"),
        ("other/".to_owned(), "another file of the scenario of"),
        ("readme".to_owned(), "the name is not MAP_SCENE_SAMPLE.pkl"),
    ] {
        let line = refused.lines().find(|line| line.contains(&file)).unwrap_or_default();
        assert!(line.contains(reason), "{file}: {line}\n{refused}");
    }
    assert_eq!(refused.lines().count(), 11, "{refused}");
    let records = deviations::read(home.path("official.parquet")).unwrap();
    // The centre of the box, 1.461 m ahead of the rear axle.
    let (last, end) = (records[&sample(22)].track[79], &turning()[237..]);
    let expected = ORIGIN.0 - 34.5 + end[0] + 1.461 * end[2].cos();
    assert!((last.x - expected).abs() < 1e-6 && (last.heading - end[2]).abs() < 1e-9, "{last:?}");
    // The index is used again as far as it was written, and only for logs that are unchanged.
    let index = fs::read_to_string(home.path("official.logs.jsonl")).unwrap();
    assert_eq!(index.lines().count(), 1);
    home.import("data", &[]);
    assert_eq!(fs::read_to_string(home.path("official.logs.jsonl")).unwrap(), index);
    fs::write(home.path("official.logs.jsonl"), &index[..index.len() / 2]).unwrap();
    assert!(texts(&home.import("data", &[])).contains("7 of 18 files"));
}

#[test]
fn the_printed_line_runs_the_imported_deviations() {
    let home = Home::new();
    for row in ROWS {
        home.put("data", &name(row), &archive("plan", &[80, 3], &turning()));
    }
    let maps = home.fixture.list.parent().unwrap().to_str().unwrap();
    // On a straight log, axle and centre continue it equally well.
    let refused = texts(&home.import("data", &["--maps", maps]));
    assert!(refused.contains("several layouts fit") && refused.contains("--pose rear-axle"), "{refused}");
    let output = home.import("data", &["--maps", maps, "--pose", "rear-axle"]);
    let text = texts(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("by the taxonomy of this program: the files state none"), "{text}");
    let line = text.lines().find(|line| line.starts_with("reactsim run ")).unwrap();
    let out = home.path("run");
    let mut words: Vec<&str> = line.split(' ').skip(1).collect();
    *words.last_mut().unwrap() = &out;
    words.extend(["--models", "log-replay,idm"]);
    let run = reactsim(&words);
    assert_eq!(run.status.code(), Some(0), "{}", texts(&run));
    assert!(texts(&run).contains("6 scenarios, reactive protocol"), "{}", texts(&run));
}
