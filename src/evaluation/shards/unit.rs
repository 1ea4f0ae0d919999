//! One unit of a run, carried out.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use rand::TryRng;
use serde::{Deserialize, Serialize};

use super::error::ShardError;
use super::plan::{ShardPlan, Unit};
use crate::evaluation::file_record::CompanionRecord;
use crate::evaluation::folder::{
    EVENTS, FAILURES, PROVENANCE, ROLLOUTS, ROWS, cannot_read, cannot_write, line,
};
use crate::evaluation::left_out::LeftOut;
use crate::evaluation::runner::carry_out;
use crate::evaluation::{Execution, Plan, RunFolder, RunObserver, rollouts};

/// Name of the file that describes a finished unit.
pub(super) const UNIT: &str = "unit.json";
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
    /// Number of scenarios and of pairs of scenario and simulator that failed.
    pub failed: usize,
    /// Duration of the unit, seconds. It has no influence on results.
    pub seconds: f64,
    /// Number of threads.
    pub jobs: usize,
    /// Scenarios that were left out.
    pub(super) left_out: LeftOut,
    /// BLAKE3 digest of every file, by name.
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
    /// `stop` was set; nothing is kept.
    Interrupted,
}

impl ShardPlan {
    /// Returns the folder of a finished unit in a folder of units.
    pub(super) fn unit_folder(folder: &Path, number: usize, unit: &Unit) -> PathBuf {
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
    pub shards: &'a ShardPlan,
    /// The planned run, prepared in this process.
    pub plan: &'a Plan,
    /// Threads and batches.
    pub execution: Execution,
    /// Receives the progress.
    pub observer: &'a dyn RunObserver,
    /// Ends the work when it is set.
    pub stop: &'a AtomicBool,
}

impl UnitWorker<'_> {
    /// Carries out a unit and writes its results to the folder of units. `seconds` returns the time since the
    /// unit began.
    ///
    /// # Errors
    /// [`ShardError`] if the run is not the planned one, if records are missing, or if results cannot be
    /// written; nothing of the unit is kept then.
    pub fn run(&self, number: usize, seconds: &dyn Fn() -> f64) -> Result<UnitOutcome, ShardError> {
        let unit = self.shards.unit(number)?;
        let target = ShardPlan::unit_folder(self.folder, number, unit);
        if target.exists() {
            return Ok(UnitOutcome::WasFinished);
        }
        self.shards.check(unit.range.input, self.plan)?;
        let partial = self.folder.join(partial_name(&format!("{number:06}-{:.16}", unit.key), self.folder)?);
        let done = self.write(&partial, unit, seconds).and_then(|record| {
            let Some(record) = record else { return Ok(UnitOutcome::Interrupted) };
            match fs::rename(&partial, &target) {
                Ok(()) => Ok(UnitOutcome::Finished(record)),
                Err(_) if target.exists() => Ok(UnitOutcome::WasFinished),
                Err(error) => Err(cannot_write(&target)(error).into()),
            }
        });
        if partial.exists() {
            // The reason for which nothing is kept matters more than a folder that stays.
            fs::remove_dir_all(&partial).ok();
        }
        done
    }

    /// Carries out a unit in a folder of its own. `None` if it was interrupted.
    fn write(
        &self,
        folder: &Path,
        unit: &Unit,
        seconds: &dyn Fn() -> f64,
    ) -> Result<Option<UnitRecord>, ShardError> {
        let (plan, execution) = (self.plan, self.execution);
        let run = RunFolder::create(folder, &plan.provenance())?;
        let range = Some(unit.range);
        let results = carry_out(plan, range, execution, Some(&run), plan.tally(), self.observer, self.stop)?;
        let Some(mut results) = results else { return Ok(None) };
        if results.records != unit.range.count {
            let (found, planned) = (results.records, unit.range.count);
            let name = plan.sources[unit.range.input].file.name.clone();
            return Err(ShardError::FewRecords { name, found, planned });
        }
        results.failures.sort();
        run.finish(&results.tally, &results.failures)?;
        let mut names = vec![ROWS, EVENTS, FAILURES];
        if plan.keep_rollouts {
            rollouts::join_parts(&run, &results.tally)?;
            run.remove_parts()?;
            names.push(ROLLOUTS);
        }
        let mut files = BTreeMap::new();
        for name in names {
            files.insert(name.to_owned(), CompanionRecord::of(&folder.join(name))?.blake3);
        }
        let record = UnitRecord {
            key: unit.key.clone(),
            records: results.records,
            failed: results.failures.len(),
            seconds: seconds(),
            jobs: execution.jobs,
            left_out: results.left_out,
            files,
        };
        run.put(UNIT, &line(&record))?;
        Ok(Some(record))
    }
}

/// Returns a name for a folder that is being written, which no other process chooses.
pub(super) fn partial_name(of: &str, folder: &Path) -> Result<String, ShardError> {
    let mut random = [0; 8];
    rand::rngs::SysRng.try_fill_bytes(&mut random).map_err(|e| cannot_write(folder)(io::Error::other(e)))?;
    Ok(format!("{PARTIAL}{of}-{:016x}", u64::from_le_bytes(random)))
}

/// Reads the record of a finished unit.
pub(super) fn read_record(folder: &Path, unit: usize) -> Result<UnitRecord, ShardError> {
    let path = folder.join(UNIT);
    let damaged = |reason: String| ShardError::Damaged { path: folder.to_owned(), unit, reason };
    let text = fs::read_to_string(&path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => damaged(format!("{UNIT} is missing")),
        _ => cannot_read(&path)(error).into(),
    })?;
    serde_json::from_str(&text).map_err(|error| damaged(format!("{UNIT}: {error}")))
}

/// Checks that the files of a finished unit are those that it wrote.
pub(super) fn check_files(folder: &Path, unit: usize, record: &UnitRecord) -> Result<(), ShardError> {
    let damaged = |reason: String| ShardError::Damaged { path: folder.to_owned(), unit, reason };
    for (name, digest) in &record.files {
        let path = folder.join(name);
        if !path.exists() {
            return Err(damaged(format!("{name} is missing")));
        }
        if CompanionRecord::of(&path)?.blake3 != *digest {
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
    match crate::files::lock(&folder.join(PROVENANCE)) {
        Ok(lock) => lock.is_some(),
        // Killed before it wrote anything.
        Err(error) => error.kind() == io::ErrorKind::NotFound,
    }
}
