//! Tests that every format of the list passes: on small files written here, and on real files if there are
//! any.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use reactsim::formats::{FORMATS, FormatError, Input, ScenarioFormat, UndecodedScenario, parse_json, survey};
use reactsim::scene::{CURRENT, FRAMES, FUTURE, MAX_AGENTS, Scenario};
use tempfile::TempDir;

use super::{HAND_WRITTEN, argoverse2, gpudrive, nuplan, read_at, scenarionet};
use crate::small_scenarios::write;
use reactsim_test_support::proto::{self, Proto};

/// Time limit for reading one small file, in a build for tests on a machine with other work.
const TIME_LIMIT: Duration = Duration::from_secs(20);
/// Number of lengths to which each file is truncated.
const TRUNCATIONS: usize = 32;
/// Number of random changes of one byte of each file.
const CHANGES: usize = 200;
/// Frame outside of all recordings.
const MISSING_FRAME: usize = 100_000;
/// Number of scenarios that are read from a real file.
const REAL_SCENARIOS: usize = 2;

/// Small valid files of one format.
struct Fixture {
    /// Id of the format.
    format: &'static str,
    /// Writes a file with one scenario to a folder, then the files that accompany it. Returns their paths in
    /// this order.
    write: fn(&Path) -> Vec<PathBuf>,
    /// Id of the AV.
    av: &'static str,
    /// Whether checksums detect every change of the content.
    has_checksums: bool,
    /// Another frame that can be the current one; `None` if the format fixes the current frame.
    other_frame: Option<usize>,
    /// A real file in the shared data, if there is one of this format.
    real: Option<&'static str>,
}

/// One fixture per format. A new format needs an entry here.
const FIXTURES: &[Fixture] = &[
    Fixture {
        format: "womd",
        write: |folder| {
            let mut message = Proto { frames: 120, ..Proto::default() };
            message.tracks[1].5 = 0..120;
            file(folder, "a.tfrecord", &proto::records(&[message]))
        },
        av: "8",
        has_checksums: true,
        other_frame: Some(29),
        real: Some("data/womd/val/womd-val-00000-of-00002.tfrecord.zst"),
    },
    Fixture {
        format: "native",
        write: |folder| {
            let path = folder.join("a.parquet");
            let scenario = parse_json(Path::new("a.json"), HAND_WRITTEN.as_bytes()).unwrap();
            write(&path, [scenario]);
            vec![path]
        },
        av: "av",
        has_checksums: true,
        other_frame: None,
        real: None,
    },
    Fixture {
        format: "nuplan",
        write: nuplan::small,
        av: "ego",
        has_checksums: false,
        other_frame: None,
        real: Some("data/nuplan/nuplan-v1.1/splits/mini/2000.01.04.12.00.00_veh-00_00000_00011.db"),
    },
    Fixture {
        format: "json",
        write: |folder| file(folder, "a.json", HAND_WRITTEN.as_bytes()),
        av: "av",
        has_checksums: false,
        other_frame: None,
        real: None,
    },
    Fixture {
        format: "gpudrive",
        write: gpudrive::small,
        av: "8",
        has_checksums: false,
        other_frame: None,
        real: Some("data/gpudrive/old_nosid_a037d975d5b0.json"),
    },
    Fixture {
        format: "argoverse2",
        write: argoverse2::small,
        av: "AV",
        has_checksums: false,
        other_frame: Some(28),
        real: Some(
            "data/av2/0a0af725-fbc3-41de-b969-3be718f694e2/scenario_0a0af725-fbc3-41de-b969-3be718f694e2.parquet",
        ),
    },
    Fixture {
        format: "scenarionet",
        write: scenarionet::small,
        av: "8",
        has_checksums: false,
        other_frame: Some(29),
        real: Some("data/scenarionet/womd_18.pkl"),
    },
];

fn file(folder: &Path, name: &str, content: &[u8]) -> Vec<PathBuf> {
    let path = folder.join(name);
    fs::write(&path, content).unwrap();
    vec![path]
}

/// A format with its fixture in a folder of its own.
struct Case {
    format: &'static dyn ScenarioFormat,
    fixture: &'static Fixture,
    folder: TempDir,
    /// The file with the scenario, then those that accompany it.
    files: Vec<PathBuf>,
}

impl Case {
    fn read(&self) -> Vec<Result<Scenario, FormatError>> {
        read(self.format, &self.files[0])
    }

    /// Reads damaged files and checks scenarios and errors. Returns the digests of the scenarios.
    fn read_damaged(&self, what: &str) -> Vec<String> {
        let what = format!("{}: {what}", self.fixture.format);
        let (format, path) = (self.format, self.files[0].clone());
        let (sender, receiver) = mpsc::channel();
        // On a thread of its own, since a reader that hangs must not hang the tests.
        thread::spawn(move || sender.send(read(format, &path)));
        let all = match receiver.recv_timeout(TIME_LIMIT) {
            Ok(all) => all,
            Err(RecvTimeoutError::Timeout) => panic!("{what}: not read after {TIME_LIMIT:?}"),
            Err(RecvTimeoutError::Disconnected) => panic!("{what}: the reader panicked"),
        };
        assert!(!all.is_empty(), "{what}: neither a scenario nor an error");
        let mut digests = Vec::new();
        for one in all {
            match one {
                Ok(scenario) => {
                    check_scenario(&scenario, &what);
                    digests.push(scenario.digest());
                }
                Err(error) => {
                    // The damaged file, or one that the damage leads to: another version of a map.
                    assert!(error.path.starts_with(self.folder.path()), "{what}: {error}");
                    let text = error.to_string();
                    assert!(text.starts_with(&*self.folder.path().to_string_lossy()), "{what}: {text}");
                    assert!(!text.contains(char::is_control), "{what}: {text:?}");
                }
            }
        }
        digests
    }
}

/// All formats, each with its fixture written to a new folder.
fn cases() -> impl Iterator<Item = Case> {
    FORMATS.iter().map(|&format| {
        let fixture = FIXTURES.iter().find(|f| f.format == format.id());
        let fixture = fixture.unwrap_or_else(|| panic!("no fixture of the format {}", format.id()));
        let folder = tempfile::tempdir().unwrap();
        let files = (fixture.write)(folder.path());
        Case { format, fixture, folder, files }
    })
}

/// The formats with a real file. Missing files are reported once each.
fn real_files() -> Vec<(&'static dyn ScenarioFormat, PathBuf)> {
    let path = |f: &dyn ScenarioFormat| FIXTURES.iter().find(|x| x.format == f.id())?.real;
    FORMATS.iter().filter_map(|&f| Some((f, crate::shared(path(f)?)?))).collect()
}

fn read(format: &'static dyn ScenarioFormat, path: &Path) -> Vec<Result<Scenario, FormatError>> {
    match Input::new(path.to_owned(), format).open() {
        Ok(scenarios) => scenarios.collect(),
        Err(error) => vec![Err(error)],
    }
}

/// Checks that only this format recognises a file.
fn check_recognised(format: &dyn ScenarioFormat, path: &Path) {
    let by: Vec<&str> = FORMATS.iter().filter(|f| f.recognises(path)).map(|f| f.id()).collect();
    assert_eq!(by, [format.id()], "{}", path.display());
}

/// Checks what every scenario guarantees, from whatever file.
fn check_scenario(scenario: &Scenario, what: &str) {
    let what = format!("{what}: {}", scenario.id);
    let (start, future) = (&scenario.start, &scenario.log_future);
    let agents = start.agents.len();
    assert!((1..=MAX_AGENTS).contains(&agents), "{what}: {agents} agents");
    assert_eq!((start.history.len(), future.tracks.len()), (agents, agents), "{what}");
    for (a, agent) in start.agents.iter().enumerate() {
        let track = scenario.logged(a);
        assert_eq!(track.len(), FRAMES, "{what}: {}", agent.id);
        assert!(track[CURRENT].is_some(), "{what}: {} is absent", agent.id);
        assert!(agent.length > 0.0 && agent.width > 0.0, "{what}: {agent:?}");
        assert!(agent.length.is_finite() && agent.width.is_finite(), "{what}: {agent:?}");
        for state in track.iter().flatten() {
            // NaN is an unknown velocity.
            let velocity = [state.vx, state.vy];
            assert!(state.is_finite() && !velocity.iter().any(|v| v.is_infinite()), "{what}: {state:?}");
        }
    }
    let av = start.now(0);
    assert_eq!((av.x, av.y), (0.0, 0.0), "{what}: the AV is the origin");
    assert!(scenario.origin.iter().all(|v| v.is_finite()), "{what}: {}", scenario.origin);
    let times = &scenario.timestamps;
    assert!(times.is_empty() || times.len() == FRAMES, "{what}: {} timestamps", times.len());
    assert!(times.iter().all(|t| t.is_finite()), "{what}: {times:?}");
    let map = &start.map;
    for (l, light) in start.lights.iter().enumerate() {
        assert_eq!(scenario.light_states(l).len(), FRAMES, "{what}: light {l}");
        assert!(light.lane < map.lanes.len() && light.stop_point.iter().all(|v| v.is_finite()), "{what}");
    }
    for lane in &map.lanes {
        let neighbors = lane.left.iter().chain(&lane.right).map(|n| n.lane);
        let mut links = lane.successors.iter().chain(&lane.predecessors).copied().chain(neighbors);
        assert!(links.all(|l| l < map.lanes.len()), "{what}: links of lane {}", lane.id);
    }
    let lanes = map.lanes.iter().flat_map(|l| l.baseline.points());
    let lines = map.road_edges.iter().map(|e| &e.points).chain(map.road_lines.iter().map(|l| &l.points));
    let areas = map.crosswalks.iter().map(|c| &c.outline);
    let areas = areas.chain(map.speed_bumps.iter().chain(&map.driveways).map(|s| &s.outline));
    let ground = map.drivable_area.iter().flatten();
    let rings = ground.flat_map(|p| p.holes.iter().chain([&p.exterior])).chain(&map.intersections);
    let mut points = lanes.chain(lines.chain(areas).chain(rings).flatten());
    assert!(points.all(|p| p.x.is_finite() && p.y.is_finite()), "{what}: points of the map");
    if let Some(deviation) = &scenario.deviation {
        assert_eq!(deviation.track.len(), FUTURE, "{what}: the deviated AV");
        assert!(deviation.track.iter().all(|s| s.is_finite()), "{what}: the deviated AV");
    }
}

/// Checks that a file opened for several threads gives these scenarios, whichever record is decoded first.
fn check_undecoded(input: &Input, expected: &[Scenario]) {
    let records: Vec<_> = input.open_undecoded().unwrap().take(expected.len()).collect();
    assert_eq!(records.len(), expected.len());
    let digest = |record: Result<UndecodedScenario, FormatError>| {
        let (scenario, known) = record.unwrap().decode_with_digest().unwrap();
        assert_eq!(known.is_some(), input.format.id() == "native", "files of the program state digests");
        assert!(known.is_none_or(|known| known == scenario.digest()));
        scenario.digest()
    };
    let decode = || records.into_iter().rev().map(digest).collect();
    let mut digests: Vec<String> = thread::scope(|scope| scope.spawn(decode).join().unwrap());
    digests.reverse();
    assert_eq!(digests, expected.iter().map(Scenario::digest).collect::<Vec<_>>());
}

#[test]
fn there_is_one_fixture_per_format() {
    let mut fixtures: Vec<&str> = FIXTURES.iter().map(|f| f.format).collect();
    let mut formats: Vec<&str> = FORMATS.iter().map(|f| f.id()).collect();
    fixtures.sort_unstable();
    formats.sort_unstable();
    assert_eq!(fixtures, formats);
}

#[test]
fn files_are_recognised_by_their_format_only() {
    for case in cases() {
        check_recognised(case.format, &case.files[0]);
        let found = survey(case.folder.path()).unwrap();
        let inputs: Vec<&PathBuf> = found.inputs.iter().map(|i| &i.path).collect();
        assert_eq!(inputs, [&case.files[0]], "maps are no scenarios");
        assert!(found.passed_over.is_empty(), "{:?}", found.passed_over);
        assert!(Input::new(case.files[0].clone(), case.format).companions().iter().all(|c| c.is_file()));
    }
    real_files().iter().for_each(|(format, path)| check_recognised(*format, path));
}

#[test]
fn scenarios_are_valid_and_the_same_in_every_reading() {
    for case in cases() {
        let scenarios: Vec<Scenario> = case.read().into_iter().map(|s| s.unwrap()).collect();
        assert_eq!(scenarios.len(), 1, "{}", case.fixture.format);
        check_scenario(&scenarios[0], case.fixture.format);
        assert_eq!(scenarios[0].start.agents[0].id, case.fixture.av);
        let again = case.read().remove(0).unwrap();
        assert_eq!(again.digest(), scenarios[0].digest(), "{}", case.fixture.format);
        let input = Input::new(case.files[0].clone(), case.format);
        check_undecoded(&input, &scenarios);
    }
}

#[test]
fn real_scenarios_are_valid_and_the_same_in_every_reading() {
    for (format, path) in real_files() {
        let input = Input::new(path, format);
        let read = || input.open().unwrap().take(REAL_SCENARIOS).map(|s| s.unwrap());
        let scenarios: Vec<Scenario> = read().collect();
        assert!(!scenarios.is_empty(), "{}", format.id());
        for (scenario, again) in scenarios.iter().zip(read()) {
            check_scenario(scenario, format.id());
            assert_eq!(again.digest(), scenario.digest(), "{}", format.id());
        }
        check_undecoded(&input, &scenarios);
    }
}

#[test]
fn the_current_frame_can_be_chosen_or_is_refused() {
    for case in cases() {
        let (path, id) = (&case.files[0], case.fixture.format);
        let usual = case.read().remove(0).unwrap();
        if let Some(frame) = case.fixture.other_frame {
            let scenario = read_at(path, frame).unwrap();
            check_scenario(&scenario, id);
            assert_ne!(scenario.digest(), usual.digest(), "{id}");
        } else {
            let error = read_at(path, CURRENT).unwrap_err().to_string();
            assert!(error.contains(&format!("the format {id} fixes the current frame")), "{error}");
        }
        // Behind the end, and before there is a history.
        for frame in [MISSING_FRAME, CURRENT - 1] {
            let error = read_at(path, frame).unwrap_err();
            assert_eq!(error.path, *path);
            assert!(error.to_string().contains(&frame.to_string()), "{error}");
        }
        assert!(read_at(path, usize::MAX).is_err(), "{id}");
    }
}

#[test]
fn truncated_files_are_refused_by_name() {
    for case in cases() {
        for path in &case.files {
            let sound = fs::read(path).unwrap();
            let lengths = (0..TRUNCATIONS).map(|i| i * sound.len() / TRUNCATIONS).chain([sound.len() - 1]);
            for length in lengths {
                fs::write(path, &sound[..length]).unwrap();
                let what = format!("{} truncated to {length} bytes", path.display());
                let scenarios = case.read_damaged(&what);
                assert!(scenarios.is_empty(), "{what}: read without an error");
            }
            fs::write(path, &sound).unwrap();
        }
    }
}

#[test]
fn changed_bytes_give_a_valid_scenario_or_an_error() {
    let mut stream = ChaCha8Rng::seed_from_u64(0);
    let mut below = |end: usize| (stream.next_u64() % end as u64) as usize;
    for case in cases() {
        let digest = case.read().remove(0).unwrap().digest();
        for path in &case.files {
            let sound = fs::read(path).unwrap();
            for _ in 0..CHANGES {
                let mut changed = sound.clone();
                let (at, change) = (below(sound.len()), 1 + below(255));
                changed[at] ^= change as u8;
                fs::write(path, &changed).unwrap();
                let what = format!("{} with byte {at} changed by {change:#04x}", path.display());
                let scenarios = case.read_damaged(&what);
                let is_same = scenarios.iter().all(|s| *s == digest);
                assert!(is_same || !case.fixture.has_checksums, "{what}: another scenario");
            }
            fs::write(path, &sound).unwrap();
        }
    }
}

#[test]
fn empty_files_zeros_and_folders_are_refused_by_name() {
    for case in cases() {
        for path in &case.files {
            let sound = fs::read(path).unwrap();
            for (what, content) in [("empty", Vec::new()), ("zeros", vec![0; 4096])] {
                fs::write(path, content).unwrap();
                let scenarios = case.read_damaged(&format!("{} {what}", path.display()));
                assert!(scenarios.is_empty(), "{}: {what}", path.display());
            }
            fs::remove_file(path).unwrap();
            fs::create_dir(path).unwrap();
            let scenarios = case.read_damaged(&format!("{} is a folder", path.display()));
            assert!(scenarios.is_empty(), "{}: a folder", path.display());
            fs::remove_dir(path).unwrap();
            fs::write(path, &sound).unwrap();
        }
    }
}
