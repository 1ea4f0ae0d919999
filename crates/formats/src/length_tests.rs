//! Scenarios of other lengths than the benchmark, in every format that tests here can write.
#![allow(clippy::unwrap_used, reason = "tests stop at what they did not expect")]

use std::fs;
use std::num::NonZeroUsize;
use std::path::Path;

use reactsim_scene::{
    AgentState, Certificate, DeviatedTrack, Deviation, Frame, Length, Response, Scenario, ScenarioParts,
};
use reactsim_test_support::nuplan::Fixture;
use reactsim_test_support::proto::{self, Proto};

use crate::{
    CurrentFrames, FutureChoice, Input, LengthChoice, crop, deviations, find_inputs, native, rollouts,
};

const LOG: Option<FutureChoice> = Some(FutureChoice::Log);

fn steps(steps: usize) -> Option<FutureChoice> {
    Some(FutureChoice::Steps(steps))
}

/// Reads a file with this choice.
fn read(
    path: &Path,
    frames: CurrentFrames,
    history: Option<usize>,
    future: Option<FutureChoice>,
) -> Vec<Result<Scenario, String>> {
    let length = LengthChoice { history, future };
    let input = Input { frames, length, ..find_inputs(path).unwrap().remove(0) };
    let text = |error: crate::FormatError| error.to_string();
    match input.open() {
        Ok(scenarios) => scenarios.map(|scenario| scenario.map_err(text)).collect(),
        Err(error) => vec![Err(text(error))],
    }
}

/// Reads the only scenario of a file at its own current frame.
fn one(path: &Path, history: Option<usize>, future: Option<FutureChoice>) -> Result<Scenario, String> {
    let mut all = read(path, CurrentFrames::Stated, history, future);
    assert_eq!(all.len(), 1);
    all.remove(0)
}

/// A recording of `frames` frames in which the AV drives 1 m per frame from x = 5000 m on.
fn recording(folder: &Path, frames: usize, current: u64) -> std::path::PathBuf {
    let mut message = Proto { frames, current, ..Proto::default() };
    message.tracks[0].5 = 0..frames;
    message.tracks[1].5 = 0..frames;
    let path = folder.join("a.tfrecord");
    fs::write(&path, proto::records(&[message])).unwrap();
    path
}

fn written(path: &Path, scenarios: &[&Scenario]) {
    let mut writer = native::Writer::create(path).unwrap();
    scenarios.iter().for_each(|scenario| writer.write(scenario).unwrap());
    writer.finish().unwrap();
}

#[test]
fn recordings_are_cut_to_the_requested_length() {
    let folder = tempfile::tempdir().unwrap();
    let path = recording(folder.path(), 199, 10);
    let usual = one(&path, None, None).unwrap();
    assert_eq!(usual.length(), Length::BENCHMARK);
    // The numbers of the benchmark give the same scenario.
    assert_eq!(one(&path, Some(11), steps(80)).unwrap().digest(), usual.digest());
    for (history, future, expected) in [
        (None, steps(150), (11, 150)),
        (None, steps(60), (11, 60)),
        (Some(2), None, (2, 80)),
        (Some(5), LOG, (5, 188)),
        (None, LOG, (11, 188)),
    ] {
        let scenario = one(&path, history, future).unwrap();
        let length = scenario.length();
        assert_eq!((length.history, length.future), expected);
        assert_eq!(scenario.start.now(0), usual.start.now(0));
        assert_eq!(scenario.timestamps.len(), length.frames());
        let last = scenario.logged_at(0, length.frames() - 1).unwrap();
        assert!((last.x - length.future as f64).abs() < 1e-6, "{}", last.x);
        assert!(scenario.repairs.is_empty(), "{:?}", scenario.repairs);
        assert_eq!(scenario.start.light_history[0].len(), length.history);
        assert_eq!(scenario.log_future.lights[0].len(), length.future);
    }
    assert!(!crate::sketch(&usual).contains("\"length\""));
    let sketch = crate::sketch(&one(&path, Some(5), steps(150)).unwrap());
    assert!(sketch.starts_with("{\"v\":1,\"length\":[4,155],\"agents\":["), "{}", &sketch[..60]);
    for (history, future, expected) in [
        (
            Some(21),
            steps(179),
            "timestamps_seconds is 199 entries, expected 200 entries (20 s at 10 Hz) or more",
        ),
        (None, steps(189), "timestamps_seconds is 199 entries, expected 200 entries (20 s at 10 Hz) or more"),
        (Some(1), None, "history is 1, expected 2 to 100 frames"),
        (Some(101), None, "history is 101, expected 2 to 100 frames"),
        (None, steps(0), "future is 0, expected 1 to 6000 steps"),
        (None, steps(6001), "future is 6001, expected 1 to 6000 steps"),
    ] {
        let error = one(&path, history, future).unwrap_err();
        assert!(error.ends_with(expected), "{error}");
    }
    let later = read(&path, CurrentFrames::At(100), Some(100), LOG).remove(0).unwrap();
    assert_eq!(later.length(), Length { history: 100, future: 98 });
    // What ends at the current frame is filled up for the benchmark only.
    let path = recording(folder.path(), 11, 10);
    assert_eq!(one(&path, Some(3), None).unwrap().repairs["frames at the end that are not recorded"], 80);
    for future in [steps(60), LOG] {
        let error = one(&path, None, future).unwrap_err();
        assert!(error.contains("timestamps_seconds is 11 entries, expected "), "{error}");
    }
}

#[test]
fn the_first_frame_with_a_longer_history_is_taken_and_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = recording(folder.path(), 199, 10);
    let scenario = one(&path, Some(21), steps(150)).unwrap();
    assert_eq!(scenario.length(), Length { history: 21, future: 150 });
    assert_eq!(scenario.notes()["later-frame"].detail.as_deref(), Some("10 frames after it"));
    let chosen = read(&path, CurrentFrames::At(20), Some(21), steps(150)).remove(0).unwrap();
    assert_eq!((scenario.start.now(0), scenario.origin), (chosen.start.now(0), chosen.origin));
    assert!(chosen.notes().get("later-frame").is_none());
    // Only if the stated frame has fewer before it than requested.
    let path = recording(folder.path(), 199, 30);
    let stated = one(&path, Some(21), None).unwrap();
    assert!(stated.notes().get("later-frame").is_none() && stated.origin.x == 5030.0);
    // Without a request, the stated frame is wrong.
    let path = recording(folder.path(), 199, 5);
    assert_eq!(one(&path, Some(11), None).unwrap().notes()["later-frame"].count, 1);
    let error = one(&path, None, None).unwrap_err();
    let expected = "current_time_index is 5, expected at least 10, so that there are as many frames before \
                    it; choose another with `current-frame` or `window-step`";
    assert!(error.ends_with(expected), "{error}");
    let path = recording(folder.path(), 199, 150);
    let error = one(&path, None, None).unwrap_err();
    assert!(error.ends_with("of 199 in the record; choose another with `current-frame` or `window-step`"));
}

#[test]
fn windows_are_as_many_as_fit() {
    let folder = tempfile::tempdir().unwrap();
    let path = recording(folder.path(), 199, 10);
    let windows = |step: usize, history, future| -> Vec<(String, usize)> {
        let every = CurrentFrames::Every(NonZeroUsize::new(step).unwrap());
        let all = read(&path, every, history, future).into_iter().map(Result::unwrap);
        all.map(|scenario| (scenario.id.clone(), scenario.length().future)).collect()
    };
    let named = |all: &[(&str, usize)]| -> Vec<(String, usize)> {
        all.iter().map(|(id, future)| ((*id).to_owned(), *future)).collect()
    };
    assert_eq!(windows(50, None, None), named(&[("made@10", 80), ("made@60", 80), ("made@110", 80)]));
    assert_eq!(windows(50, None, steps(90)), named(&[("made@10", 90), ("made@60", 90)]));
    assert_eq!(windows(90, Some(21), LOG), named(&[("made@20", 178), ("made@110", 88)]));
}

#[test]
fn native_files_have_the_windows_of_their_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let path = recording(folder.path(), 199, 10);
    let every = CurrentFrames::Every(NonZeroUsize::new(50).unwrap());
    let mut whole = one(&path, None, LOG).unwrap();
    let native = folder.path().join("a.parquet");
    let windows = |history, future| -> Vec<Scenario> {
        read(&native, every, history, future).into_iter().map(Result::unwrap).collect()
    };
    written(&native, &[&whole, &one(&path, None, None).unwrap()]);
    let first: Vec<Scenario> = read(&path, every, None, None).into_iter().map(Result::unwrap).collect();
    let found = windows(None, None);
    let ids: Vec<&str> = found.iter().map(|scenario| scenario.id.as_str()).collect();
    assert_eq!(ids, ["made@10", "made@60", "made@110", "made@10"], "the short one has one window");
    for (ours, theirs) in found.iter().zip(&first) {
        assert!((ours.origin - theirs.origin).norm() < 1e-9);
        let ids = |scenario: &Scenario| -> Vec<String> {
            scenario.start.agents.iter().map(|agent| agent.id.clone()).collect()
        };
        assert_eq!((ours.length(), ids(ours)), (theirs.length(), ids(theirs)));
        assert_eq!(ours.tracks_to_predict, theirs.tracks_to_predict, "marks are those of frame 10");
        for slot in 0..ours.start.agents.len() {
            for (a, b) in ours.logged(slot).iter().zip(theirs.logged(slot)) {
                assert_eq!(a.is_some(), b.is_some());
                assert!(a.zip(b).is_none_or(|(a, b)| (a.position() - b.position()).norm() < 1e-9));
            }
        }
        let (ours, theirs) = (&ours.start, &theirs.start);
        assert_eq!((&ours.light_history, &ours.lights.len()), (&theirs.light_history, &theirs.lights.len()));
        let lanes = ours.map.lanes.iter().zip(&theirs.map.lanes);
        let points = lanes.flat_map(|(a, b)| a.baseline.points().iter().zip(b.baseline.points()));
        points.for_each(|(a, b)| assert!((a - b).norm() < 1e-9));
        assert_eq!(ours.map.stop_lines.len(), theirs.map.stop_lines.len());
        for (a, b) in ours.map.stop_lines.iter().zip(&theirs.map.stop_lines) {
            assert!((a.ends[0] - b.ends[0]).norm() < 1e-9 && (a.ends[1] - b.ends[1]).norm() < 1e-9);
        }
    }
    let lengths = |all: Vec<Scenario>| -> Vec<(String, usize)> {
        all.into_iter().map(|scenario| (scenario.id.clone(), scenario.length().future)).collect()
    };
    let long = lengths(windows(Some(21), LOG));
    assert_eq!(long[..4], [20, 70, 120, 170].map(|frame| (format!("made@{frame}"), 198 - frame)));
    assert_eq!(long.len(), 6, "frames 20 and 70 of the short one");
    let input = Input { frames: every, ..find_inputs(&native).unwrap().remove(0) };
    let from: Vec<String> = input.open_from(2).unwrap().map(|d| d.unwrap().decode().unwrap().id).collect();
    assert_eq!(from, ["made@110", "made@10"]);
    let errors = read(&native, every, None, steps(300));
    assert_eq!(errors.len(), 2);
    let expected = "record 0: scenario `made`: the number of frames is 199, expected 311 or more";
    assert!(errors[0].as_ref().unwrap_err().ends_with(expected), "{:?}", errors[0]);
    // A deviated AV and a note are of the whole.
    let track = vec![whole.start.now(0); 188];
    whole.deviation = Some(DeviatedTrack { category: None, track, certificate: None });
    whole.repairs.insert(reactsim_scene::LATER_FRAME.to_owned(), 10);
    written(&native, &[&whole]);
    let window = windows(None, None).remove(1);
    assert!(window.deviation.is_none() && window.notes().get("later-frame").is_none());
    assert_eq!(window.repairs["deviated AVs, which windows do not have"], 1);
    // All agents stay all agents.
    written(&native, &[&one(&path, None, LOG).unwrap().with_all_agents()]);
    let all = windows(None, None).remove(1);
    assert_eq!(all.start.agents.len(), first[1].clone().with_all_agents().start.agents.len());
}

#[test]
fn native_files_hold_scenarios_of_any_length() {
    let folder = tempfile::tempdir().unwrap();
    let path = recording(folder.path(), 199, 10);
    let of = |history, future| one(&path, history, future).unwrap();
    let (usual, long, short) = (of(None, None), of(None, steps(150)), of(Some(2), steps(60)));
    let native = folder.path().join("a.parquet");
    written(&native, &[&usual]);
    let before = fs::read(&native).unwrap();
    // Only the number of frames up to the current one needs a column.
    written(&native, &[&usual, &long]);
    let has_column = |path: &Path| crate::table::TableReader::open(path).unwrap().has("history");
    assert!(!has_column(&native));
    written(&native, &[&usual, &long, &short]);
    assert!(has_column(&native));
    let back: Vec<Scenario> =
        read(&native, CurrentFrames::Stated, None, None).into_iter().map(Result::unwrap).collect();
    for (back, scenario) in back.iter().zip([&usual, &long, &short]) {
        assert_eq!((back.digest(), back.length()), (scenario.digest(), scenario.length()));
    }
    written(&native, &[&back[0]]);
    assert_eq!(fs::read(&native).unwrap(), before);
    // A shorter scenario is the one that the recording gives; a longer one is refused.
    written(&native, &[&long]);
    assert_eq!(one(&native, Some(2), steps(60)).unwrap().digest(), short.digest());
    assert_eq!(one(&native, None, LOG).unwrap().digest(), long.digest());
    let error = one(&native, None, steps(151)).unwrap_err();
    assert!(
        error.ends_with(
            "record 0: scenario `made`: the number of frames of the future is 150, expected at least the 151 \
             that are requested with `future`"
        ),
        "{error}"
    );
    let error = one(&native, Some(12), None).unwrap_err();
    assert!(error.contains("frames of the history is 11, expected at least the 12"), "{error}");
}

#[test]
fn shorter_deviated_avs_have_no_certificate() {
    let folder = tempfile::tempdir().unwrap();
    let mut scenario = one(&recording(folder.path(), 199, 10), None, steps(100)).unwrap();
    let now = scenario.start.now(0);
    let response = Response {
        agent: "7".to_owned(),
        leader: None,
        reaction_step: 3,
        nudge: 0.0,
        peak_deceleration: 1.0,
        clearance: 1.0,
        effort: None,
        track: vec![scenario.start.now(1); 101],
    };
    let certificate = Some(Certificate { responses: vec![response] });
    let (category, track) = (Some(Deviation::Lateral), vec![now; 100]);
    scenario.deviation = Some(DeviatedTrack { category, track, certificate });
    let path = folder.path().join("a.parquet");
    written(&path, &[&scenario]);
    let back = one(&path, None, None).unwrap();
    assert_eq!(back.deviation, scenario.deviation);
    let mut cut = back.clone();
    crop(&mut cut, LengthChoice { history: Some(4), future: None }).unwrap();
    assert_eq!((cut.length().history, &cut.deviation), (4, &back.deviation));
    crop(&mut cut, LengthChoice { history: None, future: steps(30) }).unwrap();
    let deviation = cut.deviation.unwrap();
    assert_eq!((deviation.track.len(), deviation.category), (30, Some(Deviation::Lateral)));
    assert_eq!(deviation.certificate, None);
}

#[test]
fn hand_written_scenarios_state_their_length() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.json");
    let write = |more: &str| {
        let text = format!(
            r#"{{"format": "reactsim-scenario-v1", "id": "a", "intent": "a test", {more}
            "agents": [{{"id": "av", "length": 5, "width": 2, "motion": {{"at": [0, 0], "speed": 10,
            "pieces": [{{"seconds": 12, "acceleration": 0}}]}}}}]}}"#
        );
        fs::write(&path, text).unwrap();
    };
    write(r#""history": 21, "future": 150,"#);
    let scenario = one(&path, None, None).unwrap();
    assert_eq!(scenario.length(), Length { history: 21, future: 150 });
    assert!((scenario.logged_at(0, 0).unwrap().x + 20.0).abs() < 1e-9);
    assert!((scenario.logged_at(0, 170).unwrap().x - 150.0).abs() < 1e-9);
    let shorter = one(&path, Some(11), steps(120)).unwrap();
    assert_eq!(shorter.length(), Length { history: 11, future: 120 });
    assert!(one(&path, None, steps(151)).unwrap_err().contains("frames of the future is 150"));
    write(r#""future": 600,"#);
    assert_eq!(one(&path, None, LOG).unwrap().length(), Length { history: 11, future: 600 });
    write("");
    let error = one(&path, None, None).unwrap_err();
    assert!(error.ends_with("expected pieces of at most 8 s in total"), "{error}");
    for wrong in [r#""history": 1,"#, r#""future": 0,"#, r#""history": 101,"#, r#""future": 6001,"#] {
        write(wrong);
        let error = one(&path, None, None).unwrap_err();
        assert!(error.ends_with("frames, expected 2 to 100 and 1 to 6000 frames"), "{error}");
    }
}

#[test]
fn windows_of_nuplan_logs_have_the_requested_length() {
    // 221 rows of the 20 Hz clock; scenarios start at row 20.
    let made = Fixture::write();
    let usual = one(&made.log, None, None).unwrap();
    assert_eq!(usual.length(), Length::BENCHMARK);
    let longest = one(&made.log, None, LOG).unwrap();
    assert_eq!((longest.length(), &longest.id), (Length { history: 11, future: 100 }, &usual.id));
    let short = one(&made.log, Some(2), steps(60)).unwrap();
    assert_eq!((short.length(), &short.id), (Length { history: 2, future: 60 }, &usual.id));
    assert_eq!(short.logged_at(0, 61), usual.logged_at(0, 70));
    let error = one(&made.log, Some(12), steps(100)).unwrap_err();
    assert!(error.contains("with 22 rows of the 20 Hz clock before it and 200 after it"), "{error}");
    // Time jumps after row 120.
    let jump = "UPDATE lidar_pc SET timestamp = timestamp + 5000000 WHERE hex(token) > '7000000000000078'";
    let made = made.log(jump);
    assert_eq!(one(&made.log, None, LOG).unwrap().length().future, 50);
    let error = one(&made.log, None, steps(60)).unwrap_err();
    assert!(error.contains("rows are missing here"), "{error}");
    assert_eq!(one(&made.log, None, steps(50)).unwrap().length().future, 50);
}

fn line(count: usize) -> Vec<AgentState> {
    (0..count).map(|k| AgentState { x: k as f64, y: 0.0, heading: 0.0, vx: 10.0, vy: 0.0 }).collect()
}

#[test]
fn deviations_have_a_state_per_step() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.json");
    let write = |x: usize, y: usize| {
        let list = |n: usize| format!("{:?}", vec![0.0; n]);
        let text = format!(
            r#"{{"format": "reactsim-deviations-v1", "deviations": [{{"scenario_id": "a", "x": {}, "y": {},
            "heading": {}}}]}}"#,
            list(x),
            list(y),
            list(x)
        );
        fs::write(&path, text).unwrap();
        deviations::read(&path).map(|all| all["a"].track.len()).map_err(|error| error.to_string())
    };
    assert_eq!([write(150, 150), write(60, 60), write(6000, 6000)], [Ok(150), Ok(60), Ok(6000)]);
    assert!(write(150, 149).unwrap_err().ends_with("y is 149 steps, expected 150 steps"));
    assert!(write(0, 0).unwrap_err().ends_with("is 0 steps, expected 1 to 6000 steps"));
    assert!(write(6001, 6001).unwrap_err().ends_with("is 6001 steps, expected 1 to 6000 steps"));
}

#[test]
fn rollouts_of_any_length_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.parquet");
    let record = |steps: usize| rollouts::RolloutRecord {
        scenario_id: format!("{steps}"),
        simulator: "a".to_owned(),
        rollout: 0,
        origin: None,
        agent_ids: vec!["av".to_owned(), "b".to_owned()],
        tracks: vec![line(steps).into_iter().map(Some).collect::<Vec<Frame>>(), vec![None; steps]],
    };
    let records = [record(80), record(150), record(1)];
    let mut writer = rollouts::Writer::create(&path).unwrap();
    records.iter().for_each(|record| writer.write(record).unwrap());
    writer.finish().unwrap();
    let back: Vec<_> = rollouts::read(&path).unwrap().map(Result::unwrap).collect();
    assert_eq!(back, records);
    assert!(rollouts::to_pickle(&records[..1]).is_ok());
    let error = rollouts::to_pickle(&records[1..2]).unwrap_err().to_string();
    assert_eq!(error, "the number of steps of `150` is 150, expected 80, as in ReactSim-Bench");
}

#[test]
fn parts_of_a_length_are_assembled_with_it() {
    let length = Length { history: 3, future: 4 };
    let agent = reactsim_scene::Agent {
        id: "av".to_owned(),
        kind: reactsim_scene::AgentKind::Vehicle,
        length: 4.0,
        width: 2.0,
    };
    let track = line(7).into_iter().map(Some).collect();
    let logged = reactsim_scene::LoggedAgent { agent, track, heights: Vec::new() };
    let parts =
        ScenarioParts { id: "a".to_owned(), length, agents: vec![logged], ..ScenarioParts::default() };
    let scenario = Scenario::assemble(parts).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.parquet");
    written(&path, &[&scenario]);
    let back = one(&path, None, None).unwrap();
    assert_eq!((back.length(), back.digest()), (length, scenario.digest()));
}
