//! A few records of a run, carried out to see what all of them will cost.

use std::fs;
use std::io;
use std::path::Path;

use super::error::ShardError;
use super::plan::ShardPlan;
use super::unit::{UnitWorker, partial_name};
use crate::evaluation::folder::cannot_read;
use crate::evaluation::runner::carry_out;
use crate::evaluation::{EvaluationError, RUN_FILES, RecordRange, RunFolder, rollouts};

/// Number of records of a unit in a sample.
const RECORDS: usize = 8;

/// Size of a sample of records, and of its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleResults {
    /// Number of records that were run.
    pub records: usize,
    /// Size of their results, bytes.
    pub bytes: u64,
}

impl UnitWorker<'_> {
    /// Carries out the first records of units that are spread evenly over the plan, about `most` records in
    /// all, and removes the results. `None` if `stop` was set.
    ///
    /// # Errors
    /// [`ShardError`] if results cannot be written to the folder of units.
    pub fn sample(&self, most: usize) -> Result<Option<SampleResults>, ShardError> {
        let mut results = SampleResults { records: 0, bytes: 0 };
        for range in ranges(self.shards, most) {
            let path = self.folder.join(partial_name("sample", self.folder)?);
            let done = self.sample_range(&path, range);
            // A folder that cannot be removed takes space and does no other harm.
            fs::remove_dir_all(&path).ok();
            let Some((records, bytes)) = done? else { return Ok(None) };
            results.records += records;
            results.bytes += bytes;
        }
        Ok(Some(results))
    }

    /// Runs a range in a folder of its own; returns the number of records and the size of their results.
    fn sample_range(&self, path: &Path, range: RecordRange) -> Result<Option<(usize, u64)>, EvaluationError> {
        let plan = self.plan;
        let run = RunFolder::create(path, &plan.provenance())?;
        let tally = plan.tally();
        let results =
            carry_out(plan, Some(range), self.execution, Some(&run), tally, self.observer, self.stop)?;
        let Some(results) = results else { return Ok(None) };
        if plan.keep_rollouts {
            rollouts::join_parts(&run, &results.tally)?;
        }
        let mut bytes = 0;
        for name in RUN_FILES {
            match fs::metadata(path.join(name)) {
                Ok(metadata) => bytes += metadata.len(),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(cannot_read(&path.join(name))(error)),
            }
        }
        Ok(Some((results.records, bytes)))
    }
}

/// Returns the first records of evenly spread units.
fn ranges(shards: &ShardPlan, most: usize) -> Vec<RecordRange> {
    // Several records of a unit, as opening a file costs time too.
    let units = shards.units.len().min(most.div_ceil(RECORDS));
    let of = |i: usize| {
        let range = shards.units[i * shards.units.len() / units].range;
        RecordRange { count: range.count.min(most.div_ceil(units)), ..range }
    };
    (0..units).map(of).collect()
}
