//! Formats: round trips, agreement of compressions, damage, odd input.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "tests stop at what they did not expect, and say what they skip"
)]

mod argoverse2;
mod by_number;
mod conformance;
mod damage;
mod gpudrive;
mod hostile;
mod nuplan;
mod odd;
mod scenarionet;
mod tables;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use arrow_array::{ArrayRef, RecordBatch};
use parquet::arrow::ArrowWriter;
use reactsim::formats::{
    CurrentFrames, FormatError, FutureChoice, Input, LengthChoice, UndecodedScenario, find_inputs, native,
    open,
};
use reactsim::scene::{AgentKind, Lane, LaneClass, LightState, RoadEdgeKind, RoadMap, Scenario};

use reactsim_test_support::proto::{self, Proto};

use crate::small_scenarios::write;

/// Text of a refusal, and the change of valid input that causes it.
pub(crate) type Case<T> = (&'static str, fn(&mut T));

pub(crate) fn digests(path: &Path) -> Vec<Result<String, FormatError>> {
    match open(path) {
        Ok(scenarios) => scenarios.map(|s| s.map(|s| s.digest())).collect(),
        Err(error) => vec![Err(error)],
    }
}

pub(crate) fn good(path: &Path) -> Vec<Scenario> {
    open(path).unwrap().map(|s| s.unwrap()).collect()
}

/// Returns the scenario of a file with this current frame.
pub(crate) fn read_at(path: &Path, current_frame: usize) -> Result<Scenario, FormatError> {
    let input = find_inputs(path).unwrap().remove(0);
    let input = Input { frames: CurrentFrames::At(current_frame), ..input };
    let undecoded: Vec<_> = input.open_undecoded().unwrap().collect();
    assert_eq!(undecoded.len(), 1);
    let read = input.open().and_then(|mut scenarios| scenarios.next().unwrap());
    let also = undecoded.into_iter().next().unwrap().and_then(UndecodedScenario::decode);
    assert_eq!(
        also.ok().map(|s| s.digest()),
        read.as_ref().ok().map(Scenario::digest),
        "on other threads too"
    );
    read
}

/// Returns the scenario of a file with these numbers of frames.
pub(crate) fn read_length(
    path: &Path,
    history: Option<usize>,
    future: Option<FutureChoice>,
) -> Result<Scenario, String> {
    let length = LengthChoice { history, future };
    let input = Input { length, ..find_inputs(path).unwrap().remove(0) };
    input.open().and_then(|mut scenarios| scenarios.next().unwrap()).map_err(|error| error.to_string())
}

/// Checks that two readings of one recording agree: the same agents, in any order, and the same logs to 1 cm.
pub(crate) fn logs_agree(ours: &Scenario, theirs: &Scenario) {
    let near = |a: f64, b: f64| (a - b).abs() < 0.01;
    let id = &ours.id;
    assert!(near(ours.origin.x, theirs.origin.x) && near(ours.origin.y, theirs.origin.y), "{id}");
    assert_eq!(ours.start.agents.len(), theirs.start.agents.len(), "{id}");
    for (a, x) in ours.start.agents.iter().enumerate() {
        let b = theirs.start.agents.iter().position(|y| y.id == x.id).unwrap();
        let y = &theirs.start.agents[b];
        assert_eq!(x.kind, y.kind);
        assert!(near(x.length, y.length) && near(x.width, y.width), "{id}: {x:?} {y:?}");
        for (f, pair) in ours.logged(a).into_iter().zip(theirs.logged(b)).enumerate() {
            match pair {
                (None, None) => {}
                (Some(p), Some(q)) => {
                    let turned = (p.heading - q.heading).sin().abs();
                    assert!(near(p.x, q.x) && near(p.y, q.y) && turned < 1e-4, "{id}: {}: frame {f}", x.id);
                    assert!(near(p.vx, q.vx) && near(p.vy, q.vy), "{id}: {}: frame {f}", x.id);
                }
                _ => panic!("{id}: {}: present in one of both at frame {f}", x.id),
            }
        }
    }
}

/// Checks that two readings of one map agree: lanes by their ids, with class, links and points, and the
/// numbers of its other elements.
pub(crate) fn maps_agree(ours: &RoadMap, theirs: &RoadMap) {
    assert_eq!(ours.lanes.len(), theirs.lanes.len());
    let names =
        |map: &RoadMap, all: &[usize]| all.iter().map(|&l| map.lanes[l].id.clone()).collect::<BTreeSet<_>>();
    for lane in &ours.lanes {
        let other = theirs.lanes.iter().find(|other| other.id == lane.id).unwrap();
        assert_eq!(lane.class, other.class, "{}", lane.id);
        for of in [|lane: &Lane| lane.successors.clone(), |lane: &Lane| lane.predecessors.clone()] {
            assert_eq!(names(ours, &of(lane)), names(theirs, &of(other)), "{}", lane.id);
        }
        let (p, q) = (lane.baseline.points(), other.baseline.points());
        assert_eq!(p.len(), q.len(), "{}", lane.id);
        assert!(p.iter().zip(q).all(|(p, q)| (p - q).amax() < 0.01), "{}", lane.id);
    }
    let counts = |map: &RoadMap| {
        let lines = [map.road_edges.len(), map.road_lines.len()];
        (lines, map.crosswalks.len(), map.driveways.len(), map.speed_bumps.len())
    };
    assert_eq!(counts(ours), counts(theirs));
}

/// Returns the number of recorded states of vehicles at more than 5 m/s, and of those among them that do not
/// move in the direction of their heading.
pub(crate) fn moving(scenario: &Scenario) -> (usize, usize) {
    let vehicles = scenario.start.agents.iter().enumerate().filter(|(_, a)| a.kind == AgentKind::Vehicle);
    let states = vehicles.flat_map(|(a, _)| scenario.logged(a)).flatten().filter(|s| s.speed() > 5.0);
    states.fold((0, 0), |(all, astray), state| {
        (all + 1, astray + usize::from(state.forward_speed() < 0.9 * state.speed()))
    })
}

/// Returns the first scenario of a file, or the message after the path of the folder.
pub(crate) fn first(path: &Path) -> Result<Scenario, String> {
    let folder = format!("{}/", path.parent().unwrap().display());
    let told = |error: FormatError| error.to_string().strip_prefix(&folder).unwrap().to_owned();
    open(path).map_err(told)?.next().unwrap().map_err(told)
}

/// Checks that every change is refused with its message, after the place `begin`.
pub(crate) fn check_cases<T>(
    cases: &[Case<T>],
    begin: &str,
    read: impl Fn(fn(&mut T)) -> Result<Scenario, String>,
) {
    for (expected, change) in cases {
        let error = read(*change).unwrap_err();
        assert!(error.starts_with(begin) && error.contains(expected), "expected {expected}: {error}");
    }
}

pub(crate) fn write_table(
    out: impl std::io::Write + Send,
    columns: impl IntoIterator<Item = (&'static str, ArrayRef)>,
) {
    let batch = RecordBatch::try_from_iter(columns).unwrap();
    let mut writer = ArrowWriter::try_new(out, batch.schema(), None).unwrap();
    writer.write(&batch).unwrap();
    writer.close().unwrap();
}

pub(crate) fn gzip(content: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut out, content).unwrap();
    out.finish().unwrap()
}

/// Returns the only message that reading a file gives.
pub(crate) fn refusal(path: &Path) -> String {
    let mut all = digests(path);
    assert_eq!(all.len(), 1, "{all:?}");
    all.remove(0).unwrap_err().to_string()
}

/// Checks the scenario `made`, which files of GPUDrive and of ScenarioNet state each in their words.
fn check_made(s: &Scenario) {
    assert_eq!((s.id.as_str(), s.origin.x, s.origin.y), ("made", 1020.0, 0.0));
    let ids: Vec<&str> = s.start.agents.iter().map(|a| a.id.as_str()).collect();
    assert_eq!(ids, ["8", "7", "9"], "the AV, then by distance, then in the order of the file");
    assert_eq!(s.start.agents[2].kind, AgentKind::Pedestrian);
    assert!(s.start.history[1][2].is_none() && s.start.history[1][3].is_some());
    assert!((s.start.now(0).heading - 0.01).abs() < 1e-12 && s.start.now(0).vx == 10.0);
    assert_eq!((s.tracks_to_predict[0].as_str(), s.objects_of_interest[0].as_str()), ("7", "9"));
    let map = &s.start.map;
    assert_eq!(map.lanes.iter().map(|l| l.id.as_str()).collect::<Vec<_>>(), ["100", "101", "102"]);
    assert_eq!((&map.lanes[0].successors[..], &map.lanes[1].predecessors[..]), (&[1][..], &[0][..]));
    assert_eq!(map.lanes[1].class, LaneClass::Freeway);
    let edges = (map.road_edges[0].kind, map.road_edges[1].kind);
    assert_eq!(edges, (RoadEdgeKind::Boundary, RoadEdgeKind::Median));
    assert_eq!(map.road_lines[0].paint, 6, "solid single yellow");
    let shown = s.light_states(0);
    assert_eq!((shown[0], shown[1], shown[90]), (Some(LightState::Stop), None, Some(LightState::ArrowGo)));
}

const HAND_WRITTEN: &str = r#"{
  "format": "reactsim-scenario-v1", "id": "hand", "intent": "Everything that a file can hold.", "av": "av",
  "agents": [
    {"id": "b", "length": 4.5, "width": 1.9, "motion": {"at": [10, 0], "speed": 10, "frames": [3, 60]}},
    {"id": "av", "length": 4.8, "width": 2.0, "motion": {"at": [40, 0], "speed": 10}},
    {"id": "cone", "kind": "other", "length": 0.5, "width": 0.5, "motion": {"at": [40, 5]}}
  ],
  "tracks_to_predict": ["b"], "objects_of_interest": ["av"],
  "map": {
    "lanes": [
      {"id": "1", "speed_limit": 13.9, "path": {"at": [-50, 0], "pieces": [{"length": 100}, {"length": 30, "curvature": 0.05}]},
       "successors": ["2"], "left": [{"lane": "3"}]},
      {"id": "2", "kind": "connector", "points": [[80, 20], [90, 40]], "polygon": [[78, 20], [82, 20], [92, 40], [88, 40]]},
      {"id": "3", "class": "freeway", "points": [[-50, 3.5], [50, 3.5]], "half_width": 2}
    ],
    "road_edges": [{"points": [[-50, -2], [50, -2]]}],
    "road_lines": [{"paint": 2, "points": [[-50, 2], [50, 2]]}],
    "stop_lines": [{"kind": "yield", "lane": "3", "at": [20.3, 4]}],
    "crosswalks": [[[60, -5], [63, -5], [63, 8]]], "speed_bumps": [[[0, 0], [1, 0], [1, 1]]],
    "driveways": [[[0, 9], [1, 9], [1, 10]]], "intersections": [[[70, 0], [90, 0], [90, 40]]],
    "drivable_area": [{"exterior": [[-50, -2], [90, -2], [90, 50], [-50, 50]], "holes": [[[0, 20], [5, 20], [5, 25]]]}]
  },
  "lights": [{"lane": "1", "stop_point": [45, 0], "phases": [{"state": "go", "seconds": 4}, {"seconds": 1}, {"state": "stop", "seconds": 1}]}],
  "deviation": {"category": "lateral", "pieces": [{"seconds": 3, "shift": 2, "acceleration": -1}]}
}"#;

#[test]
fn hand_written_scenarios_survive_native_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let (json, parquet) = (folder.path().join("a.json"), folder.path().join("b.parquet"));
    fs::write(&json, HAND_WRITTEN).unwrap();
    let scenarios = good(&json);
    let scenario = &scenarios[0];
    assert_eq!(scenario.start.agents[0].id, "av");
    assert_eq!(scenario.start.map.stop_lines.len(), 2, "the given one and the light's");
    assert_eq!(scenario.start.map.lanes[1].predecessors, [0]);
    assert_eq!(scenario.light_states(0)[45], None);
    assert_eq!(scenario.deviation.as_ref().unwrap().track.len(), 80);
    write(&parquet, &scenarios);
    let back = good(&parquet);
    assert_eq!(back[0].digest(), scenario.digest());
    assert_eq!(back[0].start.map, scenario.start.map);
    assert_eq!(back[0].log_future, scenario.log_future);
    assert_eq!(back[0].deviation, scenario.deviation);
}

#[test]
fn generated_messages_survive_native_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let (womd, parquet) = (folder.path().join("a.tfrecord"), folder.path().join("b.parquet"));
    let many: Vec<Proto> = (0..19).map(|i| Proto { id: format!("s{i}"), ..Proto::default() }).collect();
    fs::write(&womd, proto::records(&many)).unwrap();
    let scenarios = good(&womd);
    assert_eq!(scenarios.len(), 19);
    write(&parquet, &scenarios);
    let before: Vec<String> = scenarios.iter().map(Scenario::digest).collect();
    let after: Vec<String> = good(&parquet).iter().map(Scenario::digest).collect();
    assert_eq!(before, after);
}

#[test]
fn compressions_agree_and_are_told_by_content() {
    let folder = tempfile::tempdir().unwrap();
    let plain = proto::records(&[Proto::default()]);
    let mut seen = Vec::new();
    let zstd = zstd::encode_all(&plain[..], 3).unwrap();
    for (name, data) in [("a", plain.clone()), ("b", gzip(&plain)), ("c", zstd)] {
        let path = folder.path().join(name);
        fs::write(&path, data).unwrap();
        seen.push(good(&path)[0].digest());
    }
    assert!(seen.iter().all(|d| *d == seen[0]));
    assert_eq!(find_inputs(folder.path()).unwrap().len(), 3);
    // Links back to the folder are not followed: two of them would double the work with every level.
    #[cfg(unix)]
    for name in ["back", "again"] {
        std::os::unix::fs::symlink(folder.path(), folder.path().join(name)).unwrap();
    }
    assert_eq!(find_inputs(folder.path()).unwrap().len(), 3);
}

#[test]
fn real_scenarios_survive_native_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let parquet = folder.path().join("real.parquet");
    for split in ["data/womd/val", "data/womd/train"] {
        let Some(path) = crate::shared(split) else { return };
        // Every fourth scenario: the others differ in nothing that matters here, and this runs in every
        // build.
        let mut before = Vec::new();
        let mut writer = native::Writer::create(&parquet).unwrap();
        for (i, scenario) in open(&path).unwrap().enumerate() {
            let scenario = scenario.unwrap();
            if i % 4 == 0 {
                before.push(scenario.digest());
                writer.write(&scenario).unwrap();
            }
        }
        writer.finish().unwrap();
        let after: Vec<String> = open(&parquet).unwrap().map(|s| s.unwrap().digest()).collect();
        assert!(before.len() > 20);
        assert_eq!(before, after);
    }
}

#[test]
fn folders_are_read_in_order_and_a_bad_file_does_not_end_them() {
    let folder = tempfile::tempdir().unwrap();
    let refused = open(folder.path()).err().unwrap().to_string();
    assert!(refused.contains("holds no scenario file") && refused.contains("womd"), "{refused}");
    let record = |id: &str| proto::records(&[Proto { id: id.into(), ..Proto::default() }]);
    fs::create_dir(folder.path().join("b")).unwrap();
    fs::write(folder.path().join("notes.txt"), "not a scenario").unwrap();
    assert!(open(folder.path()).is_err(), "nothing is recognised yet");
    fs::write(folder.path().join("b/1.tfrecord"), record("one")).unwrap();
    let cut = record("cut");
    fs::write(folder.path().join("a.tfrecord"), &cut[..cut.len() / 2]).unwrap();
    fs::write(folder.path().join("c.tfrecord"), record("three")).unwrap();
    let all: Vec<_> = open(folder.path()).unwrap().collect();
    assert_eq!(all.len(), 3);
    let error = all[0].as_ref().unwrap_err();
    assert!(error.ends_file() && error.to_string().contains("a.tfrecord: record 0: is truncated"), "{error}");
    assert_eq!(all[1].as_ref().unwrap().id, "one");
    assert_eq!(all[2].as_ref().unwrap().id, "three");
}

#[test]
fn writers_leave_nothing_half_done() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.parquet");
    let json = folder.path().join("a.json");
    fs::write(&json, HAND_WRITTEN).unwrap();
    let mut writer = native::Writer::create(&path).unwrap();
    writer.write(&good(&json)[0]).unwrap();
    assert!(!path.exists());
    drop(writer);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "only the JSON file");
    let refused = native::Writer::create(folder.path().join("none/out.parquet")).err().unwrap().to_string();
    assert!(refused.contains("none/out.parquet: could not create"), "{refused}");
}
