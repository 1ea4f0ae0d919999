//! Parquet in the long format.

use std::io::{self, Write};
use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, Float64Array, RecordBatch, StringArray, UInt64Array};
use parquet::arrow::ArrowWriter;
use reactsim_formats::table::properties;

use super::long::records;
use super::{Run, TableStyle};

pub(super) fn export(runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    let records = records(runs, style);
    let text = |of: &dyn Fn(&super::long::Record<'_>) -> String| -> ArrayRef {
        Arc::new(StringArray::from_iter_values(records.iter().map(of)))
    };
    let number = |of: &dyn Fn(&super::long::Record<'_>) -> Option<f64>| -> ArrayRef {
        Arc::new(Float64Array::from_iter(records.iter().map(of)))
    };
    let oracle: ArrayRef = Arc::new(BooleanArray::from(records.iter().map(|r| r.oracle).collect::<Vec<_>>()));
    let category: ArrayRef = Arc::new(StringArray::from_iter(records.iter().map(|r| r.category)));
    let difficulty: ArrayRef = Arc::new(StringArray::from_iter(records.iter().map(|r| r.difficulty)));
    let scenarios: ArrayRef =
        Arc::new(UInt64Array::from_iter_values(records.iter().map(|r| r.estimate.scenarios as u64)));
    let batch = RecordBatch::try_from_iter_with_nullable([
        ("run", text(&|r| r.run.to_owned()), false),
        ("av", text(&|r| r.av.to_owned()), false),
        ("simulator", text(&|r| r.simulator.to_owned()), false),
        ("oracle", oracle, false),
        ("kind", text(&|r| r.kind.to_owned()), false),
        ("category", category, true),
        ("difficulty", difficulty, true),
        ("metric", text(&|r| r.metric.to_owned()), false),
        ("mean", number(&|r| r.estimate.mean), true),
        ("low", number(&|r| r.estimate.low), true),
        ("high", number(&|r| r.estimate.high), true),
        ("scenarios", scenarios, false),
    ])
    .map_err(io::Error::other)?;
    let properties = properties().build();
    // The writer requires a `Send` sink; a table is small enough to buffer.
    let mut bytes = Vec::new();
    let mut writer =
        ArrowWriter::try_new(&mut bytes, batch.schema(), Some(properties)).map_err(io::Error::other)?;
    writer.write(&batch).map_err(io::Error::other)?;
    writer.close().map_err(io::Error::other)?;
    out.write_all(&bytes)
}
