//! Import of ReactSim-Bench: a log and its files, written here.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Output;

use reactsim::formats::{self, deviations};
use reactsim::scene::{CURRENT, Scenario};
use reactsim_test_support::nuplan::{Fixture, ORIGIN, bench_name, bench_names, hex, token};
use reactsim_test_support::pickle::{Py, archive, pickle};

use crate::program::{ended, program, reactsim};

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
        let (files, out) = (self.path(folder), self.path("official.parquet"));
        let logs = self.fixture.log.parent().unwrap().to_str().unwrap();
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
        home.put("data/lateral", &bench_name(0, row), &good(row));
    }
    let scene = hex(token(b's', 2));
    let sample = |row: u32| hex(token(b'p', row));
    let other_scene = format!("town_{}_{}.pkl", hex(token(b's', 9)), sample(25));
    home.put("data/lateral", &other_scene, &good(25));
    home.put("data/lateral", &bench_name(0, 25), &good(25));
    home.put("data", &format!("town_{scene}_{}.pkl", sample(26)), &good(26)[..900]);
    let attack = Py::List(vec![global(27), Py::Call("posix", "system", "true")]);
    home.put("data", &format!("town_{scene}_{}.pkl", sample(27)), &pickle(&attack, 4, 2));
    home.put("data", &format!("town_{scene}_{}.pkl", sample(28)), &good(50));
    home.put("data", &format!("town_{scene}_{}.pkl", hex(token(b'q', 1))), &good(30));
    home.put("data", &format!("village_{scene}_{}.pkl", sample(31)), &good(31));
    home.put("data", &format!("town_{}_{}.pkl", hex(token(b's', 9)), hex(token(b'q', 2))), &good(32));
    home.put("data", &format!("town_{scene}_{}.pkl", sample(200)), &good(33));
    home.put("data/zcopy", &bench_name(0, 22), &good(22));
    home.put("data/other", &bench_name(0, 29), &pickle(&global(29), 2, 1));
    home.put("data", "readme.pkl", b"");
    let list = format!("file,category\n{},longitudinal\n", bench_name(0, 57));
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
        home.put("data", &bench_name(0, row), &archive("plan", &[80, 3], &turning()));
    }
    let maps = home.fixture.list.parent().unwrap().to_str().unwrap();
    // On a straight log, axle and centre continue it equally well.
    let refused = texts(&home.import("data", &["--maps", maps]));
    assert!(refused.contains("several layouts fit") && refused.contains("`pose` rear-axle"), "{refused}");
    let output = home.import("data", &["--maps", maps, "--pose", "rear-axle"]);
    let text = texts(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("by the taxonomy of this program: the files state none"), "{text}");
    let line = text.lines().find(|line| line.starts_with("reactsim run ")).unwrap();
    let out = home.path("run");
    let mut words: Vec<&str> = line.split(' ').skip(1).collect();
    *words.last_mut().unwrap() = &out;
    words.extend(["--models", "log-replay,idm"]);
    let run = ended(&words, 0);
    assert!(texts(&run).contains("6 scenarios, reactive protocol"), "{}", texts(&run));
}

#[test]
fn files_of_many_logs_are_found_in_theirs() {
    const LOGS: u8 = 7;
    let home = Home::new();
    (1..LOGS).for_each(|copy| home.fixture.copy_log(copy));
    let rows = (22..60).step_by(2);
    let files: Vec<(u8, u32)> = (0..LOGS).flat_map(|copy| rows.clone().map(move |row| (copy, row))).collect();
    for &(copy, row) in &files {
        let north = 10.0 * f64::from(copy);
        let Py::Array(shape, mut values) = global(row) else { unreachable!() };
        values.iter_mut().skip(1).step_by(3).for_each(|y| *y += north);
        home.put("lateral", &bench_name(copy, row), &pickle(&Py::Array(shape, values), 4, 2));
    }
    let output = home.import("lateral", &[]);
    let text = texts(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains(&format!("{0} of {0} files: 80 × 3", files.len())), "{text}");
    let records = deviations::read(home.path("official.parquet")).unwrap();
    assert_eq!(records.len(), files.len());
    for (copy, row) in files {
        let name = bench_name(copy, row);
        let record = &records[&name[name.len() - 20..name.len() - 4]];
        assert_eq!(record.source.as_ref(), Some(&name));
        let by = (record.track[0].x - ORIGIN.0 + 40.0 - 0.25 * f64::from(row), record.track[0].y - ORIGIN.1);
        let (x, y) = (0.5 + 1.461, 10.0 * f64::from(copy));
        assert!((by.0 - x).abs() < 0.01 && (by.1 - y).abs() < 0.1, "{name}: {by:?}");
    }
    let index = fs::read_to_string(home.path("official.logs.jsonl")).unwrap();
    assert_eq!(index.lines().count(), usize::from(LOGS));
    let selection = fs::read_to_string(home.path("official.selection.json")).unwrap();
    assert_eq!(selection.matches(".db").count(), usize::from(LOGS), "{selection}");
}

/// Trajectory of the rear axle: the AV of a scenario on its logged path, braking.
fn braking(scenario: &Scenario) -> Py {
    let pose = |frame: usize| {
        let state = scenario.logged_at(0, frame).unwrap();
        let ahead = reactsim::geometry::direction(state.heading) * 1.461;
        [state.x + scenario.origin.x - ahead.x, state.y + scenario.origin.y - ahead.y, state.heading]
    };
    let step = |k: usize| {
        let time = k as f64 * (1.0 - 0.005 * k as f64);
        let (before, share) = (CURRENT + time as usize, time.fract());
        let (a, b) = (pose(before), pose(before + 1));
        let turn = reactsim::geometry::wrap(b[2] - a[2]);
        [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * turn]
    };
    Py::Array(vec![80, 3], (1..=80).flat_map(step).collect())
}

/// Returns the commands in the code blocks of the guide.
fn commands_of_the_guide() -> Vec<&'static str> {
    let guide = include_str!("../../docs/guides/official-benchmark.md");
    let blocks = guide.split("```sh\n").skip(1).filter_map(|rest| rest.split_once("```"));
    blocks.flat_map(|(block, _)| block.lines()).collect()
}

#[test]
fn the_commands_of_the_guide_run_on_logs_of_nuplan() {
    let Some(data) = crate::shared("data/nuplan") else { return };
    let logs = data.join("nuplan-v1.1/splits/mini");
    let home = tempfile::tempdir().unwrap();
    let files = home.path().join("ReactSim-Bench-Data");
    fs::create_dir(&files).unwrap();
    let selection = home.path().join("some.json");
    let some = serde_json::json!({ "format": "reactsim-nuplan-v1", "logs": [logs], "every_seconds": 0.5 });
    fs::write(&selection, some.to_string()).unwrap();
    let mut names = BTreeMap::new();
    for log in fs::read_dir(&logs).unwrap() {
        names.append(&mut bench_names(&log.unwrap().path()));
    }
    let mut made = 0;
    for scenario in formats::find_inputs(&selection).unwrap()[0].open().unwrap() {
        let scenario = scenario.unwrap();
        fs::write(files.join(&names[&scenario.id]), pickle(&braking(&scenario), 4, 2)).unwrap();
        made += 1;
    }
    assert!(made >= 8, "{made}");
    let commands = commands_of_the_guide();
    assert_eq!(commands.len(), 5);
    for command in commands {
        let command = command.replace("nuplan-v1.1/splits/trainval", logs.to_str().unwrap());
        // All baselines would take minutes.
        let command = command.replace("reactsim run ", "reactsim run --models log-replay,idm ");
        let words: Vec<&str> = command.split(' ').skip(1).collect();
        let output = program().current_dir(home.path()).args(&words).output().unwrap();
        let text = texts(&output);
        // Log replay of other scenarios has other numbers than the paper.
        assert_eq!(output.status.code(), Some(i32::from(words[0] == "verify")), "{command}\n{text}");
        match words[0] {
            "import" => assert!(text.contains(&format!("{made} of {made} files: 80 × 3")), "{text}"),
            "verify" => assert!(text.contains("| A-AV Coll.") && text.contains("0.9829"), "{text}"),
            _ => {}
        }
    }
    assert_eq!(fs::read_dir(home.path().join("rollouts")).unwrap().count(), made);
    assert!(fs::read_to_string(home.path().join("official.html")).unwrap().contains("TrajTok"));
}
