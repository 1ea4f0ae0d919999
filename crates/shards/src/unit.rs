//! One unit, carried out.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use rand::TryRng;
use reactsim_files::{FolderLock, digest, lock_folder, replace};
use serde::{Deserialize, Serialize};

use super::error::{ShardError, cannot_read, cannot_write};
use super::plan::{ShardPlan, Unit};
use super::work::{UnitResults, Work};

/// Name of the file that describes a finished unit.
const UNIT: &str = "unit.json";
/// Name of the folder with its results.
pub(super) const RESULTS: &str = "results";
/// Beginning of the names of folders of finished units.
const FINISHED: &str = "unit-";
/// Beginning of the names of folders that are being written.
pub(super) const PARTIAL: &str = "partial-";

/// A finished unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitRecord {
    /// Key of the unit in the plan.
    pub key: String,
    /// Number of records that were read.
    pub records: usize,
    /// Number of failures.
    pub failed: usize,
    /// Duration of the unit, seconds. It has no influence on results.
    pub seconds: f64,
    /// Number of threads.
    pub jobs: usize,
    /// BLAKE3 digest of every file of the results, by name.
    pub(super) files: BTreeMap<String, String>,
}

impl UnitRecord {
    /// Returns the time of all threads, seconds.
    pub fn core_seconds(&self) -> f64 {
        self.seconds * self.jobs as f64
    }
}

/// How a unit ended.
#[derive(Clone, Debug, PartialEq)]
pub enum UnitOutcome {
    /// It is finished now.
    Finished(UnitRecord),
    /// Its results were there already, or another process was faster.
    WasFinished,
    /// The work was interrupted; nothing is kept.
    Interrupted,
}

impl ShardPlan {
    /// Returns the folder of a finished unit in a folder of units.
    fn unit_folder(folder: &Path, number: usize, unit: &Unit) -> PathBuf {
        folder.join(format!("{FINISHED}{number:06}-{:.16}", unit.key))
    }

    /// Returns the numbers of the units that are not finished.
    pub fn missing(&self, folder: &Path) -> Vec<usize> {
        let all = self.units.iter().enumerate();
        let missing = all.filter(|(number, unit)| !Self::unit_folder(folder, *number, unit).exists());
        missing.map(|(number, _)| number).collect()
    }

    /// Reads the records of all finished units, by number.
    ///
    /// # Errors
    /// [`ShardError::Damaged`] if a record cannot be read.
    pub fn finished(&self, folder: &Path) -> Result<BTreeMap<usize, UnitRecord>, ShardError> {
        let mut records = BTreeMap::new();
        for (number, unit) in self.units.iter().enumerate() {
            let path = Self::unit_folder(folder, number, unit);
            if path.exists() {
                records.insert(number, read_record(&path, number)?);
            }
        }
        Ok(records)
    }
}

/// Carries out units of a plan in this process.
#[derive(Clone, Copy)]
pub struct UnitWorker<'a> {
    /// Folder of the plan and the units.
    pub folder: &'a Path,
    /// The plan.
    pub plan: &'a ShardPlan,
    /// The planned work, prepared in this process.
    pub work: &'a dyn Work,
    /// Number of threads of the work.
    pub jobs: usize,
}

impl UnitWorker<'_> {
    /// Carries out a unit and writes its results to the folder of units. `seconds` returns the time since the
    /// unit began.
    ///
    /// # Errors
    /// [`ShardError`] if the work is not the planned one, if records are missing, or if results cannot be
    /// written; nothing of the unit is kept then.
    pub fn run(&self, number: usize, seconds: &dyn Fn() -> f64) -> Result<UnitOutcome, ShardError> {
        let unit = self.plan.unit(number)?;
        let target = ShardPlan::unit_folder(self.folder, number, unit);
        if target.exists() {
            return Ok(UnitOutcome::WasFinished);
        }
        self.work.check(self.plan, unit)?;
        let partial = PartialFolder::create(self.folder, &format!("{number:06}-{:.16}", unit.key))?;
        let Some(results) = self.work.carry_out(unit, &partial.results())? else {
            return Ok(UnitOutcome::Interrupted);
        };
        let record = self.record(unit, &results, &partial.results(), seconds)?;
        let text = serde_json::to_string(&record).map_err(ShardError::work)?;
        let path = partial.path.join(UNIT);
        replace(&path, |out| writeln!(out, "{text}")).map_err(cannot_write(&path))?;
        Ok(if partial.finish(&target)? { UnitOutcome::Finished(record) } else { UnitOutcome::WasFinished })
    }

    /// Describes a unit that was carried out.
    fn record(
        &self,
        unit: &Unit,
        results: &UnitResults,
        folder: &Path,
        seconds: &dyn Fn() -> f64,
    ) -> Result<UnitRecord, ShardError> {
        let UnitResults { records, failed, ref files } = *results;
        if records != unit.range.count {
            return Err(ShardError::FewRecords { found: records, planned: unit.range.count });
        }
        let mut digests = BTreeMap::new();
        for name in files {
            let path = folder.join(name);
            digests.insert((*name).to_owned(), digest(&path).map_err(cannot_read(&path))?.blake3);
        }
        Ok(UnitRecord {
            key: unit.key.clone(),
            records,
            failed,
            seconds: seconds(),
            jobs: self.jobs,
            files: digests,
        })
    }
}

/// A folder that is being written. It is removed if it does not become a finished unit.
pub(super) struct PartialFolder {
    path: PathBuf,
    /// Shows that the folder is not abandoned.
    lock: Option<FolderLock>,
}

impl PartialFolder {
    /// Creates a folder in a folder of units, with a name that no other process chooses.
    pub(super) fn create(folder: &Path, of: &str) -> Result<Self, ShardError> {
        let mut random = [0; 8];
        let drawn = rand::rngs::SysRng.try_fill_bytes(&mut random);
        drawn.map_err(|e| cannot_write(folder)(io::Error::other(e)))?;
        let path = folder.join(format!("{PARTIAL}{of}-{:016x}", u64::from_le_bytes(random)));
        fs::create_dir(&path).map_err(cannot_write(&path))?;
        let mut created = Self { path, lock: None };
        created.lock = lock_folder(&created.path).map_err(cannot_write(&created.path))?;
        let results = created.results();
        fs::create_dir(&results).map_err(cannot_write(&results))?;
        Ok(created)
    }

    /// Returns the folder for results.
    pub(super) fn results(&self) -> PathBuf {
        self.path.join(RESULTS)
    }

    /// Gives the folder the name of a finished unit. `false` if there is one already.
    fn finish(mut self, target: &Path) -> Result<bool, ShardError> {
        // A finished unit is not locked. Merges remove partial folders without a lock, but only when the
        // unit is there from another process.
        self.lock = None;
        match fs::rename(&self.path, target) {
            Ok(()) => Ok(true),
            Err(_) if target.exists() => Ok(false),
            Err(error) => Err(cannot_write(target)(error)),
        }
    }
}

impl Drop for PartialFolder {
    fn drop(&mut self) {
        // It is not there any more if it became a unit. A folder that stays takes space and does no other
        // harm; a merge removes it.
        fs::remove_dir_all(&self.path).ok();
    }
}

/// Reads the record of a finished unit.
pub(super) fn read_record(folder: &Path, unit: usize) -> Result<UnitRecord, ShardError> {
    let path = folder.join(UNIT);
    let damaged = |reason: String| ShardError::Damaged { path: folder.to_owned(), unit, reason };
    let text = fs::read_to_string(&path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => damaged(format!("{UNIT} is missing")),
        _ => cannot_read(&path)(error),
    })?;
    serde_json::from_str(&text).map_err(|error| damaged(format!("{UNIT}: {error}")))
}

/// Checks that the files of a finished unit are those that it wrote.
pub(super) fn check_files(folder: &Path, unit: usize, record: &UnitRecord) -> Result<(), ShardError> {
    let damaged = |reason: String| ShardError::Damaged { path: folder.to_owned(), unit, reason };
    for (name, planned) in &record.files {
        let path = folder.join(RESULTS).join(name);
        if !path.exists() {
            return Err(damaged(format!("{name} is missing")));
        }
        if digest(&path).map_err(cannot_read(&path))?.blake3 != *planned {
            return Err(damaged(format!("{name} was changed since it was written")));
        }
    }
    Ok(())
}

/// Returns whether a folder is of a finished unit, by its name; if so, the number in it.
pub(super) fn finished_number(name: &str) -> Option<usize> {
    name.strip_prefix(FINISHED)?.split_once('-')?.0.parse().ok()
}

/// Returns whether a partial folder was left by a process that is no longer there.
pub(super) fn is_abandoned(folder: &Path) -> bool {
    lock_folder(folder).is_ok_and(|lock| lock.is_some())
}
