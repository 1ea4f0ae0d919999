use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use reactsim_scene::{
    AgentKind, FRAMES, FUTURE, HISTORY,
    wosac::{
        CHALLENGE_ROLLOUTS, JointScene, ObjectTrajectory, ScenarioRollouts, WosacLog, WosacTrack,
        check_rollouts,
    },
};

use super::*;
use crate::FormatError;
use crate::wire::Message;

fn metadata() -> SubmissionMetadata {
    SubmissionMetadata::new("a@example.org", "method", "0")
}

/// Returns the field of a submission with these rollouts.
fn submitted(rollouts: &ScenarioRollouts) -> Vec<u8> {
    let mut field = Message::default();
    field.bytes(1, encode_rollouts(rollouts));
    field.into_bytes()
}

/// A log with three objects, of which the last is absent at the current frame.
fn log(id: &str) -> WosacLog {
    let track = |id: i32| WosacTrack {
        id,
        kind: AgentKind::Vehicle,
        length: 4.0,
        width: 2.0,
        height: 1.5,
        x: vec![10.0 * id as f32; FRAMES],
        y: vec![0.0; FRAMES],
        z: vec![0.0; FRAMES],
        heading: vec![0.0; FRAMES],
        valid: vec![id != 3; FRAMES],
    };
    WosacLog { scenario_id: id.into(), tracks: (1..=3).map(track).collect(), ..WosacLog::default() }
}

fn rollouts(id: &str) -> ScenarioRollouts {
    let trajectory = |object: i32, r: usize| ObjectTrajectory {
        object_id: object,
        x: (0..FUTURE).map(|k| (object as usize + r) as f32 + k as f32 * 0.1).collect(),
        y: vec![0.5; FUTURE],
        z: vec![-0.5; FUTURE],
        heading: vec![0.25; FUTURE],
    };
    // Every second rollout has another order of objects.
    let scene = |r: usize| {
        let order = if r.is_multiple_of(2) { [1, 2] } else { [2, 1] };
        JointScene { trajectories: order.map(|object| trajectory(object, r)).to_vec() }
    };
    ScenarioRollouts { scenario_id: id.into(), joint_scenes: (0..CHALLENGE_ROLLOUTS).map(scene).collect() }
}

fn write(path: &Path, ids: &[&[&str]]) {
    let mut writer = SubmissionWriter::create(path, "method", ids.len() as u32, &metadata()).unwrap();
    for shard in ids {
        for id in *shard {
            writer.write(&rollouts(id)).unwrap();
        }
        writer.finish_shard().unwrap();
    }
    writer.finish().unwrap();
}

fn read(path: &Path) -> (Vec<SubmittedRollouts>, Vec<FormatError>) {
    let (mut read, mut errors) = (Vec::new(), Vec::new());
    for result in SubmissionReader::open(path).unwrap() {
        match result {
            Ok(submitted) => read.push(submitted),
            Err(error) => errors.push(error),
        }
    }
    (read, errors)
}

#[test]
fn submissions_are_read_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tar.gz");
    write(&path, &[&["s0", "s1"], &[], &["s2"]]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "the file being written is removed");
    let (read_back, errors) = read(&path);
    assert!(errors.is_empty(), "{errors:?}");
    let expected = ["s0", "s1", "s2"].map(rollouts);
    assert!(read_back.iter().map(|s| &s.rollouts).eq(&expected));
    let place = |s: &SubmittedRollouts| (s.file.file_name().unwrap().to_str().unwrap().to_owned(), s.record);
    assert_eq!(place(&read_back[1]), ("method.binproto-00000-of-00003".into(), 1));
    assert_eq!(place(&read_back[2]), ("method.binproto-00002-of-00003".into(), 0));

    // The same as a plain archive, in a folder, and as single files.
    let mut plain = Vec::new();
    GzDecoder::new(File::open(&path).unwrap()).read_to_end(&mut plain).unwrap();
    let tar_path = folder.path().join("b.tar");
    fs::write(&tar_path, &plain).unwrap();
    assert_eq!(read(&tar_path).0.len(), 3);
    let is_plain = |path: &Path| SubmissionReader::open(path).unwrap().is_plain_archive();
    assert!(is_plain(&tar_path) && !is_plain(&path));
    // Whatever its name.
    fs::write(folder.path().join("c.tar.gz"), &plain).unwrap();
    assert!(is_plain(&folder.path().join("c.tar.gz")));
    let unpacked = folder.path().join("unpacked");
    tar::Archive::new(plain.as_slice()).unpack(&unpacked).unwrap();
    let (read_back, errors) = read(&unpacked);
    assert!(errors.is_empty() && read_back.iter().map(|s| &s.rollouts).eq(&expected));
    assert!(!is_plain(&unpacked));
    assert_eq!(read(&unpacked.join("method.binproto-00000-of-00003")).0.len(), 2);
    fs::remove_file(unpacked.join("method.binproto-00001-of-00003")).unwrap();
    let error = read(&unpacked).1[0].to_string();
    assert!(error.contains("2 of 3, without number 1"), "{error}");
}

#[test]
fn zeros_after_gzip_are_padding() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tar.gz");
    write(&path, &[&["s0"]]);
    let sound = fs::read(&path).unwrap();
    fs::write(&path, [sound.clone(), vec![0; 100_000]].concat()).unwrap();
    let (read_back, errors) = read(&path);
    assert!(read_back.len() == 1 && errors.is_empty(), "{errors:?}");
    fs::write(&path, [sound, vec![0; 10], b"more".to_vec()].concat()).unwrap();
    assert_eq!(read(&path).1.len(), 1, "anything else is damage");
}

#[test]
fn empty_and_damaged_archives_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        let opened = SubmissionReader::open(&path).and_then(|reader| reader.collect::<Result<Vec<_>, _>>());
        opened.unwrap_err().to_string()
    };
    let empty = refusal("empty.tar", &vec![0; 10_240]);
    assert!(empty.contains("empty.tar: the archive is empty, expected files named"), "{empty}");
    let mut archive = tar::Builder::new(Vec::new());
    let mut header = tar::Header::new_gnu();
    header.set_entry_type(tar::EntryType::Directory);
    header.set_size(0);
    archive.append_data(&mut header, "./", std::io::empty()).unwrap();
    let mut folders = archive.into_inner().unwrap();
    let without = refusal("folders.tar", &folders);
    assert!(without.contains("folders.tar: the archive is without files"), "{without}");
    folders[0] ^= 1;
    let damaged = refusal("damaged.tar", &folders);
    assert!(damaged.contains("the checksum of the first header does not match"), "{damaged}");
}

#[test]
fn metadata_are_read_and_required() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tar.gz");
    write(&path, &[&["s0"]]);
    let mut reader = SubmissionReader::open(&path).unwrap();
    assert_eq!(reader.by_ref().count(), 1);
    assert_eq!(reader.metadata(), Some(&metadata()));
    let refused = |change: fn(&mut SubmissionMetadata)| {
        let mut changed = metadata();
        change(&mut changed);
        changed.check().unwrap_err().to_string()
    };
    assert!(refused(|m| m.submission_type = None).starts_with("submission_type is missing"));
    assert!(refused(|m| m.account_name = Some(String::new())).starts_with("account_name is missing"));
    assert!(refused(|m| m.uses_camera_data = None).starts_with("uses_camera_data is missing"));
    let closed_loop = refused(|m| m.acknowledge_complies_with_closed_loop_requirement = Some(false));
    assert!(closed_loop.contains("requirement is false"));
    let error = SubmissionWriter::create(&folder.path().join("a.tar"), "a", 1, &metadata()).err().unwrap();
    assert!(error.to_string().contains("ends with `.tar.gz`"));
}

#[test]
fn archives_of_other_programs_are_read() {
    // Names in extended headers, folders, leading dots and times with fractions, as Python and tar write
    // them.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tar.gz");
    let mut archive = tar::Builder::new(GzEncoder::new(File::create(&path).unwrap(), Compression::fast()));
    let mut header = tar::Header::new_gnu();
    header.set_entry_type(tar::EntryType::Directory);
    header.set_size(0);
    archive.append_data(&mut header, "./", std::io::empty()).unwrap();
    let mut content = metadata().encode();
    for id in ["s0", "s1"] {
        content.extend(submitted(&rollouts(id)));
    }
    let long = "m".repeat(120);
    for (extension, name) in [(false, format!("./{long}.binproto")), (true, "short.binproto".to_owned())] {
        if extension {
            archive.append_pax_extensions([("mtime", b"1.5".as_slice()), ("path", b"p.binproto")]).unwrap();
        }
        let mut header = tar::Header::new_gnu();
        header.set_size(content.len() as u64);
        header.set_mode(0o600);
        archive.append_data(&mut header, name, content.as_slice()).unwrap();
    }
    archive.into_inner().unwrap().finish().unwrap();
    let (read_back, errors) = read(&path);
    assert!(errors.is_empty(), "{errors:?}");
    let names: Vec<_> = read_back.iter().map(|s| s.file.file_name().unwrap().to_str().unwrap()).collect();
    let long = format!("{long}.binproto");
    assert_eq!(names, [&long, &long, "p.binproto", "p.binproto"]);
}

#[test]
fn unpacked_numbers_are_read() {
    // Field 2 as four single numbers, then as a packed list.
    let mut trajectory = Vec::new();
    for value in [1.0f32, 2.0] {
        trajectory.push(2 << 3 | 5);
        trajectory.extend(value.to_le_bytes());
    }
    trajectory.extend([2 << 3 | 2, 4]);
    trajectory.extend(3.0f32.to_le_bytes());
    let mut scene = vec![1 << 3 | 2, trajectory.len() as u8];
    scene.extend(trajectory);
    let mut message = vec![1 << 3 | 2, 1, b'a', 2 << 3 | 2, scene.len() as u8];
    message.extend(scene);
    let decoded = decode_rollouts(&message).unwrap();
    assert_eq!(decoded.scenario_id, "a");
    assert_eq!(decoded.joint_scenes[0].trajectories[0].x, [1.0, 2.0, 3.0]);
}

#[test]
fn few_bytes_cannot_expand_to_much_memory() {
    let mut message = Vec::new();
    for _ in 0..300_000 {
        message.extend([2 << 3 | 2, 2, 1 << 3 | 2, 0]);
    }
    let error = decode_rollouts(&message).unwrap_err().to_string();
    assert!(error.contains("more than 200000"), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.binproto");
    // A length of two gigabytes, and nothing behind it.
    fs::write(&path, [1 << 3 | 2, 0x80, 0x80, 0x80, 0x80, 8]).unwrap();
    let error = read(&path).1[0].to_string();
    assert!(error.contains("at most 134217728 bytes"), "{error}");
}

/// A change of rollouts, and the error that it causes.
type Violation = (fn(&mut ScenarioRollouts), &'static str);

#[test]
fn rollouts_are_validated_in_the_order_of_the_official_code() {
    let log = log("s");
    check_rollouts(&rollouts("s"), &log).unwrap();
    // In the order of the checks: each change would also cause the errors after it.
    let violations: [Violation; 10] = [
        (|r| r.scenario_id.clear(), "scenario_id is empty, expected `s`"),
        (|r| r.joint_scenes.truncate(31), "the number of joint_scenes is 31, expected 32"),
        (
            |r| r.joint_scenes[3].trajectories[0].heading.push(0.0),
            "rollout 3: object 2: the length of heading is 81, expected 80",
        ),
        (
            |r| r.joint_scenes[3].trajectories[1].object_id = 3,
            "rollout 3: object_id is 3, expected the id of",
        ),
        (
            |r| drop(r.joint_scenes[4].trajectories.pop()),
            "rollout 4: object_id is missing for 1 objects, first 2",
        ),
        (|r| r.scenario_id = "t".into(), "scenario_id is `t`, expected `s`"),
        (
            |r| r.joint_scenes[5].trajectories[0].x[79] = f32::INFINITY,
            "rollout 5: object 2: center_x[79] is inf, expected a position",
        ),
        (
            |r| r.joint_scenes[5].trajectories[0].y[7] = f32::NAN,
            "rollout 5: object 2: center_y[7] is NaN, expected a position",
        ),
        (
            |r| r.joint_scenes[6].trajectories[1].heading[0] = 1e9,
            "rollout 6: object 2: heading[0] is 1000000000, expected a heading",
        ),
        (
            |r| {
                let double = r.joint_scenes[7].trajectories[0].clone();
                r.joint_scenes[7].trajectories.push(double);
            },
            "rollout 7: object_id is 2, expected one trajectory per object",
        ),
    ];
    let mut changed = rollouts("s");
    for (change, expected) in violations.iter().rev() {
        change(&mut changed);
        let error = check_rollouts(&changed, &log).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}, expected {expected}");
    }
}

#[test]
fn logs_without_a_future_can_be_validated_against() {
    let mut log = log("s");
    for track in &mut log.tracks {
        for column in [&mut track.x, &mut track.y, &mut track.z, &mut track.heading] {
            column.truncate(HISTORY);
        }
        track.valid.truncate(HISTORY);
    }
    log.check().unwrap();
    assert!(!log.has_future());
    check_rollouts(&rollouts("s"), &log).unwrap();
}

#[test]
fn scenarios_are_submitted_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tar.gz");
    write(&path, &[&["s0", "s1"], &["s0"]]);
    let mut check = SubmissionCheck::default();
    let mut errors = Vec::new();
    for submitted in SubmissionReader::open(&path).unwrap() {
        let submitted = submitted.unwrap();
        let log = log(&submitted.rollouts.scenario_id);
        errors.extend(check.check(&submitted, &log).err());
    }
    assert_eq!(errors.len(), 1);
    let text = errors[0].to_string();
    assert!(
        text.contains("00001-of-00002: record 0: scenario `s0`: scenario_id is submitted twice"),
        "{text}"
    );
    assert!(text.contains("00000-of-00002 has it as record 0"), "{text}");
    assert_eq!(check.scenarios(), 2);
    assert_eq!(check.missing(["s0", "s1", "s2"]), ["s2"]);
}

#[test]
fn damage_ends_one_file_and_not_the_submission() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tar");
    let mut archive = tar::Builder::new(File::create(&path).unwrap());
    let whole = submitted(&rollouts("s0"));
    let cut = &whole[..whole.len() / 2];
    for (name, content) in [("a.binproto", cut), ("notes.txt", b"text".as_slice()), ("b.binproto", &whole)] {
        let mut header = tar::Header::new_gnu();
        header.set_size(content.len() as u64);
        archive.append_data(&mut header, name, content).unwrap();
    }
    archive.into_inner().unwrap().flush().unwrap();
    let (read_back, errors) = read(&path);
    assert_eq!(read_back.len(), 1);
    let texts: Vec<String> = errors.iter().map(FormatError::to_string).collect();
    assert!(texts[0].contains("a.binproto: record 0: is truncated: the rollouts of a scenario"), "{texts:?}");
    assert!(texts[1].contains("notes.txt: the name is `notes.txt`"), "{texts:?}");
    assert_eq!(texts.len(), 2);
}
