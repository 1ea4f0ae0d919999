//! A few records, carried out to see what all of them will cost.

use std::fs;
use std::path::Path;

use super::error::{ShardError, cannot_read};
use super::plan::{ShardPlan, Unit};
use super::range::RecordRange;
use super::unit::{PartialFolder, UnitWorker};

/// Number of records of a unit in a sample.
const RECORDS: usize = 8;

/// Size of a sample of records, and of its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleResults {
    /// Number of records that were carried out.
    pub records: usize,
    /// Size of their results, bytes.
    pub bytes: u64,
}

impl UnitWorker<'_> {
    /// Carries out the first records of units that are spread evenly over the plan, about `most` records in
    /// all, and removes the results. `None` if the work was interrupted.
    ///
    /// # Errors
    /// [`ShardError`] if results cannot be written to the folder of units.
    pub fn sample(&self, most: usize) -> Result<Option<SampleResults>, ShardError> {
        let mut sample = SampleResults { records: 0, bytes: 0 };
        for (_, unit) in self.plan.sampled(most) {
            let partial = PartialFolder::create(self.folder, "sample")?;
            let Some(results) = self.work.carry_out(&unit, &partial.results())? else { return Ok(None) };
            sample.records += results.records;
            for name in results.files {
                sample.bytes += size(&partial.results().join(name))?;
            }
        }
        Ok(Some(sample))
    }
}

fn size(path: &Path) -> Result<u64, ShardError> {
    Ok(fs::metadata(path).map_err(cannot_read(path))?.len())
}

impl ShardPlan {
    /// Returns evenly spread units with their numbers, shortened to about `most` records in all.
    pub fn sampled(&self, most: usize) -> impl Iterator<Item = (usize, Unit)> {
        // Several records of a unit, as opening a file costs time too.
        let units = self.units.len().min(most.div_ceil(RECORDS));
        (0..units).map(move |i| {
            let number = i * self.units.len() / units;
            let unit = &self.units[number];
            let range = RecordRange { count: unit.range.count.min(most.div_ceil(units)), ..unit.range };
            (number, Unit { range, ..unit.clone() })
        })
    }
}
