//! A few records, carried out to see what all of them will cost.

use std::fs;
use std::path::Path;

use super::error::{ShardError, cannot_read};
use super::plan::{ShardPlan, Unit};
use super::range::RecordRange;
use super::unit::{PartialFolder, UnitWorker};

/// Size of a sample of records, and of its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleResults {
    /// Number of records that were carried out.
    pub records: usize,
    /// Size of their results, bytes.
    pub bytes: u64,
}

impl UnitWorker<'_> {
    /// Carries out the first `records` records of each of `units` units, which are spread evenly over the
    /// plan, and removes the results. `None` if the work was interrupted.
    ///
    /// # Errors
    /// [`ShardError`] if results cannot be written to the folder of units.
    pub fn sample(&self, units: usize, records: usize) -> Result<Option<SampleResults>, ShardError> {
        let mut sample = SampleResults { records: 0, bytes: 0 };
        for (_, unit) in self.plan.spread(units) {
            let range = RecordRange { count: unit.range.count.min(records), ..unit.range };
            let unit = Unit { range, ..unit.clone() };
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
    /// Returns this many units with their numbers, spread evenly over the plan; all if there are fewer.
    pub fn spread(&self, units: usize) -> impl Iterator<Item = (usize, &Unit)> {
        let units = units.min(self.units.len());
        (0..units).map(move |i| i * self.units.len() / units).map(|number| (number, &self.units[number]))
    }
}
