//! The finished units of a plan, checked before they are merged.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::error::{ShardError, cannot_read, cannot_write};
use super::plan::{ShardPlan, Unit};
use super::unit::{PARTIAL, RESULTS, UnitRecord, check_files, finished_number, is_abandoned, read_record};

/// A finished unit.
#[derive(Clone, Debug)]
pub struct FinishedUnit {
    /// Number of the unit.
    pub number: usize,
    /// The planned unit.
    pub unit: Unit,
    /// What was recorded about it.
    pub record: UnitRecord,
    /// Its folder.
    folder: PathBuf,
}

impl FinishedUnit {
    /// Returns the folder with the results.
    pub fn results(&self) -> PathBuf {
        self.folder.join(RESULTS)
    }

    /// Returns the error for results that cannot be merged.
    pub fn damaged(&self, reason: String) -> ShardError {
        ShardError::Damaged { path: self.folder.clone(), unit: self.number, reason }
    }
}

/// All units of a plan: each one finished, there once, with the files that it wrote.
#[derive(Clone, Debug)]
pub struct FinishedUnits {
    /// The units, in the order of the plan.
    pub units: Vec<FinishedUnit>,
    /// Folders that are being written, or were left by killed processes.
    partial: Vec<PathBuf>,
}

impl FinishedUnits {
    /// Checks the units in a folder.
    ///
    /// # Errors
    /// [`ShardError`] if units are missing, there twice, of another plan, or damaged.
    pub fn of(plan: &ShardPlan, folder: &Path) -> Result<Self, ShardError> {
        let (mut partial, mut found) = (Vec::new(), BTreeMap::new());
        for entry in fs::read_dir(folder).map_err(cannot_read(folder))? {
            let path = entry.map_err(cannot_read(folder))?.path();
            let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
            if name.starts_with(PARTIAL) {
                partial.push(path);
            } else if let Some(number) = finished_number(name) {
                let Some(unit) = plan.units.get(number) else { return Err(ShardError::Foreign { path }) };
                let record = read_record(&path, number)?;
                if record.key != unit.key || record.records != unit.range.count {
                    return Err(ShardError::Foreign { path });
                }
                let unit = FinishedUnit { number, unit: unit.clone(), record, folder: path.clone() };
                if let Some(FinishedUnit { folder: first, .. }) = found.insert(number, unit) {
                    return Err(ShardError::Twice { unit: number, first, second: path });
                }
            }
        }
        let missing: Vec<usize> =
            (0..plan.units.len()).filter(|number| !found.contains_key(number)).collect();
        if !missing.is_empty() {
            return Err(ShardError::Missing { missing, count: plan.units.len() });
        }
        let units: Vec<FinishedUnit> = found.into_values().collect();
        for unit in &units {
            check_files(&unit.folder, unit.number, &unit.record)?;
        }
        Ok(Self { units, partial })
    }

    /// Returns the units of a part of the work.
    pub fn of_part(&self, part: usize) -> &[FinishedUnit] {
        let first = self.units.partition_point(|unit| unit.unit.part < part);
        let end = self.units.partition_point(|unit| unit.unit.part <= part);
        &self.units[first..end]
    }

    /// Removes partial folders that were left by processes that are no longer there; returns their number.
    ///
    /// # Errors
    /// [`ShardError::Write`].
    pub fn remove_abandoned(&self) -> Result<usize, ShardError> {
        let mut removed = 0;
        for path in self.partial.iter().filter(|path| is_abandoned(path)) {
            fs::remove_dir_all(path).map_err(cannot_write(path))?;
            removed += 1;
        }
        Ok(removed)
    }
}
