//! Odd input: each case has a stated meaning or an error that names file, record, scenario, field and value.

use std::fs;
use std::num::NonZeroUsize;

use super::{Case, check_cases, good, refusal};
use reactsim::formats::{CurrentFrames, Input, UndecodedScenario, find_inputs};
use reactsim::scene::Scenario;
use reactsim_test_support::proto::{self, Proto};

fn read(change: impl FnOnce(&mut Proto)) -> Result<Scenario, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.tfrecord");
    let mut made = Proto::default();
    change(&mut made);
    fs::write(&path, proto::records(&[made])).unwrap();
    let mut scenarios = reactsim::formats::open(&path).unwrap();
    scenarios.next().unwrap().map_err(|e| {
        assert!(!e.ends_file(), "{e}");
        e.to_string().rsplit_once("f.tfrecord: ").unwrap().1.to_owned()
    })
}

#[test]
fn waymo_messages_mean_what_they_say() {
    let s = read(|_| ()).unwrap();
    assert_eq!((s.id.as_str(), s.source.as_str()), ("made", "womd"));
    assert_eq!((s.origin.x, s.origin.y), (5010.0, -20_000.0));
    let ids: Vec<&str> = s.start.agents.iter().map(|a| a.id.as_str()).collect();
    assert_eq!(ids, ["8", "9", "7"], "the AV, then by distance");
    // Unwrapped headings are kept; sizes are those of frame 10; states that are not valid are ignored,
    // whatever they hold.
    assert!((s.start.now(2).heading - 17.3).abs() < 1e-6);
    assert_eq!(s.start.agents[0].length, f64::from(5.0_f32 + 10.0 * 0.001));
    assert!(s.start.history[1][4].is_none() && s.start.history[1][5].is_some());
    assert!(s.log_future.tracks[1][29].is_none() && s.log_future.tracks[1][28].is_some());
    assert_eq!(
        (s.tracks_to_predict.as_slice(), s.objects_of_interest.len()),
        (["7".to_owned()].as_slice(), 1)
    );
    let map = &s.start.map;
    assert_eq!(map.lanes[0].successors, [1]);
    assert!((map.lanes[0].speed_limit.unwrap() - 11.176).abs() < 1e-9);
    assert_eq!(map.stop_lines.len(), 2);
    assert_eq!(s.start.light_history[0].iter().filter(|l| l.is_some()).count(), 6);
    assert!(s.repairs.is_empty(), "{:?}", s.repairs);
}

#[test]
fn odd_input_with_a_stated_meaning() {
    let s = read(|p| p.lights.push(999)).unwrap();
    assert_eq!((s.start.lights.len(), s.repairs["lights on missing lanes"]), (1, 1));
    let s = read(|p| p.lanes[1].1.push(999)).unwrap();
    assert_eq!(s.repairs["links to missing lanes"], 1);
    // A box of size zero means an absent agent.
    let s = read(|p| p.tracks[0].4 = 0.0).unwrap();
    assert_eq!((s.start.agents.len(), s.unselected.len()), (2, 1));
    assert_eq!(s.repairs["agents with a box of size zero"], 1);
    let all = s.with_all_agents();
    assert_eq!((all.start.agents.len(), all.repairs.len()), (3, 0));
    assert_eq!((all.start.agents[2].id.as_str(), all.start.agents[2].length), ("7", 0.0));
    // Agents that are never valid have no size at all.
    let s = read(|p| p.tracks[0].5 = 0..0).unwrap();
    assert_eq!((s.unselected[0].agent.length, s.start.agents.len()), (0.0, 2));
}

#[test]
fn odd_input_is_refused_by_name() {
    let cases: &[Case<Proto>] = &[
        ("agents[0].track[0].x is NaN, expected a finite coordinate", |p| p.tracks[0].2 = f64::NAN),
        ("agents[0].track[0].x is inf, expected a finite coordinate", |p| p.tracks[0].2 = f64::INFINITY),
        ("sdc_track_index is 3, expected the index of one of 3 tracks", |p| p.sdc = 3),
        ("agents[1].track[10] is absent, expected the AV present at the current frame", |p| {
            p.tracks[1].5 = 11..91;
        }),
        (
            "timestamps_seconds is 90 entries, expected 91 entries (9.1 s at 10 Hz) or more, or 11 without the future",
            |p| p.frames = 90,
        ),
        ("current_time_index is 11, expected a frame with 80 after it, of 91 in the record", |p| {
            p.current = 11
        }),
        ("timestamps is a step of 0.25 s, expected steps of 0.1 s (10 Hz)", |p| p.step = 0.25),
        ("agents[2].id is 7, expected an id that no other agent has", |p| p.tracks[2].0 = 7),
        ("map.lanes[1].id is 100, expected an id that no other lane has", |p| p.lanes[1].0 = 100),
        ("agents[0].length is NaN, expected a size of at least 0 and less than 1000 m", |p| {
            p.tracks[0].4 = f32::NAN;
        }),
        ("agents[0].track[0].heading is inf, expected a finite heading", |p| p.tracks[0].3 = f32::INFINITY),
    ];
    check_cases(cases, "record 0: scenario `made`: ", |change| read(change));
}

#[test]
fn files_of_another_kind_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x");
    for (data, expected) in [
        (&b""[..], "is empty, not a scenario file; known formats: womd ("),
        (b"\x80\x04\x95", "is a Python pickle, not a scenario file"),
        (b"{\"a\": 1}", "is a JSON file without"),
        (b"hello", "is a file of an unknown kind"),
    ] {
        fs::write(&path, data).unwrap();
        let error = refusal(&path);
        assert!(error.contains(expected), "{error}");
    }
    let error = refusal(&folder.path().join("none"));
    assert!(error.contains("none: could not read: "), "{error}");
    let empty = folder.path().join("x.tfrecord");
    fs::write(&empty, b"").unwrap();
    assert!(refusal(&empty).contains("is truncated: the first record has 0 of 12 bytes"));
}

/// A recording of 20 s, as those for training.
fn twenty_seconds() -> Proto {
    let mut message = Proto { frames: 199, ..Proto::default() };
    message.tracks[0].5 = 0..199;
    message.tracks[1].5 = 0..199;
    message
}

/// Reads a file of one recording with these current frames.
fn windows(message: &Proto, frames: CurrentFrames) -> Vec<Result<Scenario, String>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.tfrecord");
    fs::write(&path, proto::records(std::slice::from_ref(message))).unwrap();
    let input = Input { frames, ..find_inputs(&path).unwrap().remove(0) };
    let all: Vec<_> = input.open().unwrap().map(|s| s.map_err(|e| e.to_string())).collect();
    // The same from any record on.
    let from =
        input.open_from(all.len() - 1).unwrap().map(|decode| decode.and_then(UndecodedScenario::decode));
    let ids = |scenarios: &[Scenario]| scenarios.iter().map(Scenario::digest).collect::<Vec<_>>();
    let last: Vec<Scenario> = from.flatten().collect();
    assert_eq!(ids(&last), ids(&all.last().unwrap().clone().into_iter().collect::<Vec<_>>()));
    all
}

#[test]
fn recordings_of_twenty_seconds_give_one_window_or_many() {
    let message = twenty_seconds();
    let only = |frames| {
        let mut all = windows(&message, frames);
        assert_eq!(all.len(), 1);
        all.remove(0)
    };
    let stated = only(CurrentFrames::Stated).unwrap();
    assert_eq!((stated.id.as_str(), stated.origin.x), ("made", 5010.0));
    assert_eq!((stated.timestamps.len(), stated.tracks_to_predict.len()), (91, 1));
    assert!((stated.timestamps[90] - 9.0).abs() < 1e-9);
    let first = Proto { frames: 91, ..twenty_seconds() };
    assert_eq!(windows(&first, CurrentFrames::Stated)[0].as_ref().unwrap().digest(), stated.digest());

    let later = only(CurrentFrames::At(60)).unwrap();
    assert_eq!((later.id.as_str(), later.origin.x, later.timestamps[0]), ("made", 5060.0, 5.0));
    assert!(later.log_future.tracks[0].iter().all(Option::is_some));
    assert!(later.tracks_to_predict.is_empty(), "the marks are those of frame 10");
    for frame in [9, 119, usize::MAX] {
        let error = only(CurrentFrames::At(frame)).unwrap_err();
        assert!(
            error.contains(&format!("scenario `made`: the current frame is {frame}, expected")),
            "{error}"
        );
    }
    let last = only(CurrentFrames::At(118)).unwrap();
    assert!(last.log_future.tracks[0][79].is_some());

    let many = windows(&message, CurrentFrames::Every(NonZeroUsize::new(50).unwrap()));
    let many: Vec<Scenario> = many.into_iter().map(Result::unwrap).collect();
    let ids: Vec<&str> = many.iter().map(|s| s.id.as_str()).collect();
    assert_eq!(ids, ["made@10", "made@60", "made@110"]);
    assert_eq!(many[1].log_future, later.log_future);
    // A usual recording gives one window.
    let usual = windows(&Proto::default(), CurrentFrames::Every(NonZeroUsize::MIN));
    assert_eq!(usual[0].as_ref().unwrap().id, "made@10");
}

#[test]
fn windows_are_refused_for_other_formats_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.json");
    fs::write(&path, super::HAND_WRITTEN).unwrap();
    let frames = CurrentFrames::Every(NonZeroUsize::MIN);
    let input = Input { frames, ..find_inputs(&path).unwrap().remove(0) };
    let error = input.open().err().unwrap().to_string();
    assert!(error.contains("a.json: ") && error.contains("json has one window per recording"), "{error}");
}

#[test]
fn tf_examples_are_named_once_per_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("training_tfexample.tfrecord-00000-of-01000");
    // The map entry `roadgraph_samples/id`, with an empty feature.
    let entry = [&b"\x0a\x14roadgraph_samples/id"[..], b"\x12\x00"].concat();
    let features = [&[0x0a, entry.len() as u8][..], &entry].concat().repeat(3);
    let example = [&[0x0a, features.len() as u8][..], &features].concat();
    fs::write(&path, proto::framed(&[example.clone(), example.clone(), example])).unwrap();
    let error = refusal(&path);
    assert!(error.contains("the content is tf.Example records, expected records with `Scenario`"), "{error}");
}

#[test]
fn padding_far_from_the_recording_is_absent() {
    // A slot of size zero at a position that is not near the AV.
    let s = read(|p| p.tracks.push((50, 1, 600_000.0, 0.0, 0.0, 0..91))).unwrap();
    assert_eq!((s.start.agents.len(), s.unselected.len()), (3, 1));
    assert!(s.unselected[0].track.iter().all(Option::is_none));
    assert!(!s.repairs.contains_key("agents with a box of size zero"));
    assert_eq!(s.with_all_agents().start.agents.len(), 3);
}

#[test]
fn a_bad_record_does_not_end_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.tfrecord");
    let (first, third) =
        (Proto::default().encode(), Proto { id: "third".into(), ..Proto::default() }.encode());
    fs::write(&path, proto::framed(&[first, b"\xff\xff\xff".to_vec(), third])).unwrap();
    let all: Vec<_> = reactsim::formats::open(&path).unwrap().collect();
    assert_eq!(all.len(), 3);
    let error = all[1].as_ref().unwrap_err();
    assert!(error.to_string().contains("f.tfrecord: record 1: cannot be decoded: "), "{error}");
    assert_eq!(all[2].as_ref().unwrap().id, "third");
}

#[test]
fn a_damaged_payload_costs_one_record() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("train.tfrecord-00003-of-01000");
    let two = Proto { id: "two".into(), ..Proto::default() };
    let mut data = proto::records(&[Proto::default(), two]);
    data[500] ^= 4;
    fs::write(&path, data).unwrap();
    let all: Vec<_> = reactsim::formats::open(&path).unwrap().collect();
    assert_eq!(all.len(), 2);
    let error = all[0].as_ref().unwrap_err().to_string();
    assert!(error.contains("of-01000: record 0: is damaged: the checksum of the record is"), "{error}");
    assert_eq!(all[1].as_ref().unwrap().id, "two");
}

#[test]
fn absurd_lengths_allocate_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f.tfrecord");
    for length in [u64::MAX, 1 << 40, (1 << 30) - 8] {
        let mut data = length.to_le_bytes().to_vec();
        data.extend(proto::crc(&data));
        data.extend(b"short");
        fs::write(&path, data).unwrap();
        let error = refusal(&path);
        assert!(
            error.contains("at most 128 MiB") || error.contains("is truncated: the record has 5 of"),
            "{error}"
        );
    }
}

#[test]
fn hand_written_mistakes_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.json");
    for (from, to, expected) in [
        ("\"intent\": \"Everything that a file can hold.\",", "", "missing field `intent`"),
        ("\"id\": \"hand\"", "\"idd\": \"hand\"", "unknown field `idd`"),
        ("\"speed\": 10, \"frames\"", "\"speed\": 1e999, \"frames\"", "number out of range"),
        (
            "\"seconds\": 4",
            "\"seconds\": 0.05",
            "lights[0].phases[0].seconds is 0.05, expected a positive multiple",
        ),
        ("\"av\": \"av\"", "\"av\": \"me\"", "av is `me`, expected the id of an agent"),
        (
            "\"half_width\": 2",
            "\"half_width\": 0",
            "map.lanes[2].half_width is 0, expected a finite positive width",
        ),
        ("[3, 60]", "[3, 91]", "agents[0].motion.frames is [3, 91], expected [first, last] within 0 to 90"),
    ] {
        assert!(super::HAND_WRITTEN.contains(from), "{from}");
        fs::write(&path, super::HAND_WRITTEN.replacen(from, to, 1)).unwrap();
        let error = refusal(&path);
        assert!(error.contains("a.json: record 0: ") && error.contains(expected), "{error}");
    }
    fs::write(&path, super::HAND_WRITTEN).unwrap();
    assert_eq!(good(&path).len(), 1);
}
