//! Deviations and rollouts.

use std::fs;
use std::sync::Arc;

use arrow_array::builder::{Float64Builder, Int64Builder, ListBuilder};
use arrow_array::{ArrayRef, Int64Array, RecordBatch, StringArray};
use parquet::arrow::ArrowWriter;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use reactsim::formats::{deviations, rollouts};
use reactsim::geometry::Vec2;
use reactsim::scene::{AgentState, Deviation};

use super::{refusal, write_table};

fn column(values: impl Iterator<Item = Option<f64>>) -> ArrayRef {
    let mut builder = ListBuilder::new(Float64Builder::new());
    builder.append_value(values);
    Arc::new(builder.finish())
}

/// Writes a file as pandas or any other program does: without metadata of this program.
fn foreign(path: &std::path::Path, gap: Option<usize>, steps: usize) {
    let line = |by: f64| column((0..steps).map(move |k| (gap != Some(k)).then_some(by * k as f64)));
    let columns = [
        ("scenario_id", Arc::new(StringArray::from(vec!["a"])) as ArrayRef),
        ("x", line(1.0)),
        ("y", line(0.5)),
        ("heading", line(0.0)),
        ("category", Arc::new(StringArray::from(vec!["lateral"]))),
    ];
    write_table(fs::File::create(path).unwrap(), columns);
}

#[test]
fn deviations_of_other_programs_are_world_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.parquet");
    foreign(&path, None, 80);
    let all = deviations::read(&path).unwrap();
    let one = &all["a"];
    assert_eq!((one.category, one.track.len(), one.track[3].x), (Some(Deviation::Lateral), 80, 3.0));
    assert!(one.track[3].vx.is_nan());
    let moved = one.track_in(Vec2::new(2.0, -1.0));
    assert_eq!((moved[3].x, moved[3].y), (1.0, 2.5));
    foreign(&path, Some(16), 80);
    let error = deviations::read(&path).unwrap_err().to_string();
    assert!(error.ends_with("d.parquet: record 0: scenario `a`: the state at step 17 is missing, expected 80 states without gaps"), "{error}");
    foreign(&path, None, 79);
    assert_eq!(deviations::read(&path).unwrap()["a"].track.len(), 79, "the scenario decides whether it fits");
}

#[test]
fn deviations_in_json() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("d.json");
    let list = |by: f64| format!("{:?}", (0..80).map(|k| by * f64::from(k)).collect::<Vec<_>>());
    let text = format!(
        r#"{{"format": "reactsim-deviations-v1", "frame": "scenario", "deviations": [{{"scenario_id": "a", "x": {}, "y": {}, "heading": {}}}]}}"#,
        list(1.0),
        list(0.0),
        list(0.0)
    );
    fs::write(&path, &text).unwrap();
    let all = deviations::read(&path).unwrap();
    assert_eq!(all["a"].track_in(Vec2::new(9.0, 9.0))[5].x, 5.0);
    for (from, to, expected) in [
        ("79.0]", "null]", "d.json: record 0: scenario `a`: x, y, heading at step 80 is partly missing"),
        ("79.0]", "79.0, 80.0]", "scenario `a`: y is 80 steps, expected 81 steps"),
        (
            "\"frame\": \"scenario\"",
            "\"frame\": \"moon\"",
            "`frame` is `moon`, expected `world` or `scenario`",
        ),
        (
            "\"x\"",
            "\"category\": \"up\", \"x\"",
            "category is `up`, expected longitudinal, lateral or directional",
        ),
        ("-v1", "-v2", "`format` is `reactsim-deviations-v2`, expected `reactsim-deviations-v1`"),
    ] {
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let error = deviations::read(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

fn record(rollout: u32) -> rollouts::RolloutRecord {
    let state = |k: usize| AgentState { x: k as f64 / 3.0, y: -0.0, heading: 1e-300, vx: f64::NAN, vy: 0.1 };
    rollouts::RolloutRecord {
        scenario_id: "s".into(),
        simulator: "idm".into(),
        rollout,
        origin: Some(Vec2::new(1234.5, -9.25)),
        agent_ids: vec!["av".into(), "b".into()],
        tracks: vec![
            (0..80).map(|k| Some(state(k))).collect(),
            (0..80).map(|k| (k % 7 != 3).then(|| state(k))).collect(),
        ],
    }
}

#[test]
fn rollouts_survive_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.parquet");
    let mut writer = rollouts::Writer::create(&path).unwrap();
    (0..40).for_each(|i| writer.write(&record(i)).unwrap());
    writer.finish().unwrap();
    let back: Vec<_> = rollouts::read(&path).unwrap().map(|r| r.unwrap()).collect();
    assert_eq!(back.len(), 40);
    for (i, found) in back.iter().enumerate() {
        // NaN is not equal to itself, so the texts are compared.
        assert_eq!(format!("{found:?}"), format!("{:?}", record(i as u32)));
    }
    let same = back[0].tracks_in(Vec2::new(1234.5, -9.25));
    assert_eq!(format!("{same:?}"), format!("{:?}", back[0].tracks));
    let error = deviations::read(&path).unwrap_err().to_string();
    assert!(
        error.contains(
            "`reactsim.format` in the file's metadata is `reactsim-rollouts`, expected `reactsim-deviations`"
        ),
        "{error}"
    );
    let error = refusal(&path);
    assert!(error.contains("a Parquet file of another kind"), "{error}");
}

#[test]
fn ids_of_other_programs_may_be_whole_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.parquet");
    let mut ids = ListBuilder::new(Int64Builder::new());
    ids.append_value([Some(7), Some(-8)]);
    let states = |by: f64| {
        let mut agents = ListBuilder::new(ListBuilder::new(Float64Builder::new()));
        for _ in 0..2 {
            agents.values().append_value((0..80).map(|k| Some(by * f64::from(k))));
        }
        agents.append(true);
        Arc::new(agents.finish()) as ArrayRef
    };
    let columns = [
        ("scenario_id", Arc::new(Int64Array::from(vec![12])) as ArrayRef),
        ("simulator", Arc::new(StringArray::from(vec!["mine"]))),
        ("agent_id", Arc::new(ids.finish())),
        ("x", states(1.0)),
        ("y", states(0.0)),
        ("heading", states(0.0)),
    ];
    write_table(fs::File::create(&path).unwrap(), columns);
    let record = rollouts::read(&path).unwrap().next().unwrap().unwrap();
    assert_eq!((record.scenario_id.as_str(), record.agent_ids), ("12", vec!["7".into(), "-8".into()]));
}

#[test]
fn other_schemas_and_versions_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.parquet");
    let write = |keys: &[(&str, &str)]| {
        let batch = RecordBatch::try_from_iter([
            ("scenario_id", Arc::new(StringArray::from(vec!["a"])) as ArrayRef),
            ("x", Arc::new(StringArray::from(vec!["1"]))),
        ])
        .unwrap();
        let keys = keys.iter().map(|(k, v)| KeyValue::new((*k).to_owned(), (*v).to_owned())).collect();
        let properties = WriterProperties::builder().set_key_value_metadata(Some(keys)).build();
        let file = fs::File::create(&path).unwrap();
        let mut writer = ArrowWriter::try_new(file, batch.schema(), Some(properties)).unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
    };
    let (format, version) = (("reactsim.format", "reactsim-scenarios"), ("reactsim.version", "1"));
    for (keys, expected) in [
        (
            &[format, ("reactsim.version", "2")][..],
            "`reactsim.version` in the file's metadata is `2`, expected `1`",
        ),
        (&[format, version], "`reactsim.row_groups` in the file's metadata is missing, expected present"),
        (&[format, version, ("reactsim.row_groups", "4:9:7:00000000")], "checksums and row groups differ"),
        (&[], "is a Parquet file of another kind, not a scenario file"),
    ] {
        write(keys);
        let error = refusal(&path);
        assert!(error.contains(expected), "{error}");
    }
    let error = deviations::read(&path).unwrap_err().to_string();
    assert!(error.contains("s.parquet: column `x` is Utf8, expected list of float64"), "{error}");
    let mut all = rollouts::read(&path).unwrap();
    let error = all.next().unwrap().unwrap_err().to_string();
    assert!(error.contains("column `simulator` is missing, expected present"), "{error}");
    assert!(all.next().is_none());
}

#[test]
fn damaged_tables_never_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.parquet");
    foreign(&path, None, 80);
    let data = fs::read(&path).unwrap();
    for at in 0..data.len() {
        let mut bad = data.clone();
        bad[at] ^= [0x01, 0x80, 0xff][at % 3];
        fs::write(&path, &bad).unwrap();
        if let Err(error) = deviations::read(&path) {
            assert!(error.to_string().contains("t.parquet"), "{error}");
        }
        if let Ok(all) = rollouts::read(&path) {
            for error in all.filter_map(Result::err) {
                assert!(error.to_string().contains("t.parquet"), "{error}");
            }
        }
    }
}
