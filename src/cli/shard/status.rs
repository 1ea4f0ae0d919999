//! `reactsim shard status`.

use std::path::Path;

use crate::cli::{ExitStatus, write_result};
use crate::shards::{ShardPlan, UnitRecord};

/// Prints one line of numbers for people and scripts: units, finished units, records, finished records,
/// failures, and core-seconds used.
pub(super) fn status(folder: &Path) -> anyhow::Result<ExitStatus> {
    let shards = ShardPlan::read(folder)?;
    let finished = shards.finished(folder)?;
    let text = serde_json::json!({
        "units": shards.units.len(),
        "finished": finished.len(),
        "records": shards.records(),
        "finished_records": finished.values().map(|unit| unit.records).sum::<usize>(),
        "failed": finished.values().map(|unit| unit.failed).sum::<usize>(),
        "core_seconds": finished.values().map(UnitRecord::core_seconds).fold(0.0, |sum, unit| sum + unit),
        "missing": shards.missing(folder),
    });
    write_result(None, |out| writeln!(out, "{text}"))?;
    Ok(ExitStatus::Done)
}
