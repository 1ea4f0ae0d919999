//! The tables of a run folder have the content of its JSON lines.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use serde_json::Value;

use crate::program::{MINI, ended, lines_of};

/// Reads a table: a map from column to value per row.
fn table(path: &Path) -> Vec<BTreeMap<String, Field>> {
    let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
    let rows = reader.get_row_iter(None).unwrap();
    rows.map(|row| row.unwrap().into_columns().into_iter().collect()).collect()
}

fn text(field: &Field) -> Option<&str> {
    match field {
        Field::Str(text) => Some(text),
        Field::Null => None,
        other => panic!("{other:?} is no text"),
    }
}

/// Returns a score as a number.
fn number(score: &Value) -> Option<f64> {
    let (kind, value) = score.as_object()?.iter().next()?;
    match kind.as_str() {
        "count" | "value" => value.as_f64(),
        _ => match (value[0].as_f64()?, value[1].as_f64()?) {
            (_, 0.0) => None,
            (sum, n) => Some(sum / n),
        },
    }
}

#[test]
fn tables_hold_what_the_lines_hold() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let out = run.to_str().unwrap();
    ended(&["run", MINI, "--models", "constant-velocity,idm", "--rollouts", "2", "--out", out], 0);

    let values = table(&run.join("values.parquet"));
    let mut next = values.iter();
    for row in lines_of(&run.join("rows.jsonl")) {
        let metrics = row["metrics"].as_object().unwrap();
        let found: BTreeMap<&str, _> =
            next.by_ref().take(metrics.len()).map(|v| (text(&v["metric"]).unwrap(), v)).collect();
        assert_eq!(found.len(), metrics.len(), "each metric once");
        for (metric, score) in metrics {
            let value = found[metric.as_str()];
            assert_eq!(text(&value["scenario_id"]), row["scenario"].as_str());
            assert_eq!(text(&value["simulator"]), row["simulator"].as_str());
            assert_eq!(text(&value["category"]), row["category"].as_str());
            assert_eq!(text(&value["difficulty"]), row["difficulty"].as_str());
            let rollout = match &value["rollout"] {
                Field::UInt(rollout) => Some(u64::from(*rollout)),
                _ => None,
            };
            assert_eq!(rollout, row["rollout"].as_u64());
            let stored = match &value["value"] {
                Field::Double(value) => Some(*value),
                _ => None,
            };
            assert_eq!(stored, number(score), "{metric}");
            assert!(matches!(text(&value["unit"]), Some("count" | "rate" | "m" | "m/s²" | "")));
        }
    }
    assert!(next.next().is_none() && values.len() > 500, "{} values", values.len());

    let (events, lines) = (table(&run.join("events.parquet")), lines_of(&run.join("events.jsonl")));
    assert_eq!(events.len(), lines.len());
    for (event, line) in events.iter().zip(&lines) {
        for (column, field) in [
            ("scenario_id", "scenario"),
            ("metric", "metric"),
            ("agent", "agent"),
            ("partner", "partner"),
            ("reason", "reason"),
        ] {
            assert_eq!(text(&event[column]), line[field].as_str(), "{column}");
        }
        assert_eq!(event["step"], Field::UInt(line["step"].as_u64().unwrap() as u32));
        assert_eq!(event["counted"], Field::Bool(line["counted"].as_bool().unwrap()));
        let Field::MapInternal(map) = &event["values"] else { panic!("{:?}", event["values"]) };
        assert_eq!(map.entries().len(), line["values"].as_object().unwrap().len());
    }
}
