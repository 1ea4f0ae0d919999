//! The file of a curation: nothing is lost, and damage is detected.

use std::fs;
use std::path::Path;

use reactsim::curation::ScenarioRecord;
use reactsim::curation::store::{self, Writer};
use reactsim::formats::{FormatError, deviations};

use super::hand::{provenance, scenario, write};

fn twenty() -> Vec<ScenarioRecord> {
    (0..20).map(|i| scenario(&format!("s{i}"), 1 + i % 5)).collect()
}

/// Returns a text with all bits of the values: the shortest texts of two different numbers differ, and NaN
/// has one.
fn text(records: &[ScenarioRecord]) -> String {
    format!("{records:?}")
}

fn all(path: &Path) -> Result<Vec<ScenarioRecord>, FormatError> {
    store::read(path)?.collect()
}

#[test]
fn records_survive_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.parquet");
    write(&path, &twenty());
    assert_eq!(text(&all(&path).unwrap()), text(&twenty()));
    assert_eq!(store::read(&path).unwrap().provenance(), &provenance());
    // The same records give the same bytes.
    let again = folder.path().join("d.parquet");
    write(&again, &twenty());
    assert_eq!(fs::read(&path).unwrap(), fs::read(&again).unwrap());
}

#[test]
fn an_empty_curation_is_a_file_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.parquet");
    write(&path, &[scenario("without candidates", 0)]);
    assert!(all(&path).unwrap().is_empty());
}

#[test]
fn what_could_not_be_read_back_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.parquet");
    let mut writer = Writer::create(&path).unwrap();
    writer.write(&scenario("a", 2)).unwrap();
    let mut short = scenario("b", 2);
    short.candidates[1].candidate.track.pop();
    let error = writer.write(&short).unwrap_err().to_string();
    let expected = "record 1: scenario `b`: the track of candidate 1 is 80 states, expected 81 states";
    assert!(error.ends_with(expected), "{error}");
    let error = writer.write(&scenario("a", 1)).unwrap_err().to_string();
    assert!(error.ends_with("scenario_id is `a` again, expected every scenario once"), "{error}");
    drop(writer);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "a writer that is dropped leaves nothing");
}

#[test]
fn deviations_are_the_chosen_candidates() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.parquet");
    write(&path, &twenty());
    let read = deviations::read(&path).unwrap();
    // Candidate 1 is chosen; a fifth of the scenarios have only one candidate.
    assert_eq!(read.len(), 16);
    let (one, record) = (&read["s9"], scenario("s9", 5));
    let chosen = record.chosen().unwrap();
    assert_eq!(one.category, Some(chosen.taxonomy.category));
    assert_eq!(one.scenario_digest.as_deref(), Some(record.scenario_digest.as_str()));
    let track = one.track_in(record.origin);
    assert_eq!(format!("{track:?}"), format!("{:?}", chosen.candidate.future()), "step 0 is dropped");
    write(&path, &[scenario("a", 1), scenario("b", 1)]);
    let error = deviations::read(&path).unwrap_err().to_string();
    let expected = "`chosen` is false in all 2 rows, expected at least one chosen; loosen the filters of the \
                    curation or pick some in its review";
    assert!(error.ends_with(expected), "{error}");
}

#[test]
fn foreign_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.parquet");
    let refusal = || {
        let error = all(&path).unwrap_err().to_string();
        assert!(error.contains("c.parquet: "), "{error}");
        error
    };
    assert!(refusal().contains("could not read"));
    fs::write(&path, "{}").unwrap();
    assert!(refusal().contains("truncated"));
    fs::remove_file(&path).unwrap();
    let writer = reactsim::formats::rollouts::Writer::create(&path).unwrap();
    writer.finish().unwrap();
    assert!(refusal().contains("is `reactsim-rollouts`, expected `reactsim-deviations`"));
    fs::remove_file(&path).unwrap();
    write(&path, &twenty());
    let sound = fs::read(&path).unwrap();
    for (from, to, expected) in [
        (
            "reactsim.version\u{18}\u{1}1",
            "reactsim.version\u{18}\u{1}7",
            "`reactsim.version` in the file's metadata is `7`, expected `1`",
        ),
        ("reactsim.curation", "reactsim.furation", "is damaged: the checksum of the file's metadata"),
        ("\"interrupted\":false", "\"interrupted\":true ", "is damaged: the checksum of the file's metadata"),
        ("maneuver", "manoeuvr", "column `maneuver` is missing, expected present"),
    ] {
        let mut bytes = sound.clone();
        let places: Vec<usize> =
            (0..bytes.len()).filter(|&at| bytes[at..].starts_with(from.as_bytes())).collect();
        assert!(!places.is_empty(), "{from}");
        places.iter().for_each(|&at| bytes[at..at + to.len()].copy_from_slice(to.as_bytes()));
        fs::write(&path, bytes).unwrap();
        assert!(refusal().contains(expected), "{}", refusal());
    }
}

#[test]
fn damage_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.parquet");
    let records: Vec<_> = (0..10).map(|i| scenario(&format!("s{i}"), 2)).collect();
    write(&path, &records);
    let data = fs::read(&path).unwrap();
    let sound = (text(&records), format!("{:?}", provenance()));
    let check = |what: &str| {
        let read = store::read(&path).and_then(|r| {
            let provenance = format!("{:?}", r.provenance());
            Ok((text(&r.collect::<Result<Vec<_>, _>>()?), provenance))
        });
        match read {
            Ok(found) => assert!(found == sound, "{what}: other records, no error"),
            Err(error) => assert!(error.to_string().contains("c.parquet"), "{what}: {error}"),
        }
        drop(deviations::read(&path));
    };
    for (k, at) in (0..data.len()).step_by(83).enumerate() {
        let mut bad = data.clone();
        bad[at] ^= [0x01, 0x80, 0xff][k % 3];
        fs::write(&path, &bad).unwrap();
        check(&format!("byte {at} flipped"));
    }
    for length in (0..data.len()).step_by(311).chain([data.len() - 1]) {
        fs::write(&path, &data[..length]).unwrap();
        assert!(all(&path).is_err(), "cut to {length}");
    }
}
