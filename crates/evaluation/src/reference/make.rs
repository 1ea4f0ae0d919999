//! Creation of a reference from a finished run.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use reactsim_files::{FolderLock, LOCK, create_folder, lock_folder};
use reactsim_nn::cpu_class;

use super::record::FORMAT;
use super::{MachineRecord, Reference, ReferenceError, ReferenceRecord, SimulatorClass, check_values};
use crate::folder::{
    cannot_read, cannot_write, read_provenance, read_rows, read_summary, replace, rows_table,
};
use crate::layout::{PROVENANCE, REFERENCE_RECORD, ROWS_TABLE, SUMMARY};

/// The parts of a reference that are not in its run.
#[derive(Clone, Debug, Default)]
pub struct MakeOptions {
    /// Name.
    pub name: String,
    /// Title in tables; if empty, the name is used.
    pub title: String,
    /// The commands that produced the run.
    pub commands: Vec<String>,
    /// Whether to omit rows, for sets of recordings whose terms permit only aggregates.
    pub aggregates_only: bool,
}

impl MakeOptions {
    /// Returns the title, by default the name.
    pub(super) fn title(&self) -> &str {
        if self.title.is_empty() { &self.name } else { &self.title }
    }
}

/// Creates the folder of a reference and locks it, unless it exists and is not empty, or another process
/// writes it.
pub(super) fn create_empty(out: &Path) -> Result<FolderLock, ReferenceError> {
    let is_empty = || match fs::read_dir(out) {
        Ok(entries) => entries.flatten().all(|entry| entry.file_name() == LOCK),
        Err(_) => true,
    };
    let exists = || {
        let text = "exists and is not empty; choose another folder";
        ReferenceError::Unfit(format!("{} {text}", out.display()))
    };
    if !is_empty() {
        return Err(exists());
    }
    let locked = create_folder(out).and_then(|()| lock_folder(out)).map_err(cannot_write(out))?;
    locked.filter(|_| is_empty()).ok_or_else(exists)
}

/// Writes the reference of a finished run to a folder that is absent or empty, and reads it back. Must be
/// called on the machine of the run.
///
/// # Errors
/// [`ReferenceError`] for a run that is unfinished, has failures, was made by a program with uncommitted
/// changes, covers only part of a benchmark, or, unless only aggregates are published, is not on a known
/// benchmark.
pub fn make(run: &Path, out: &Path, options: &MakeOptions) -> Result<Reference, ReferenceError> {
    let place = run.display().to_string();
    let unfit = |reason: String| Err(ReferenceError::unfit(&place, reason));
    let named = !options.name.is_empty()
        && options.name.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c))
        && !options.name.starts_with('.');
    if !named {
        return unfit(format!(
            "`{}` is not a valid name of a reference: use letters, digits, `.`, `_` and `-`",
            options.name
        ));
    }
    let (summary, provenance) = (read_summary(run)?, read_provenance(run)?);
    if !provenance.is_clean() {
        return unfit(format!(
            "the run was made by a program at commit `{}`, which cannot be built again: \
             commit all changes and run again",
            provenance.commit
        ));
    }
    if provenance.cpu.as_deref().is_some_and(|cpu| cpu != cpu_class()) {
        return unfit(
            "the run was made on another class of processor: make the reference on that machine".to_owned(),
        );
    }
    if let Some(own) = provenance.own_metrics.first() {
        return unfit(format!(
            "the run has the metric `{}`, which `verify` cannot compute: \
             run again without metrics that the benchmark does not have",
            own.id
        ));
    }
    let rows = if options.aggregates_only { None } else { Some(read_rows(run)?) };
    if provenance.benchmark.is_none() && rows.is_some() {
        return unfit(
            "the run is on no known benchmark, or on a part of one: \
             other sets of scenarios have references of aggregates only"
                .to_owned(),
        );
    }
    check_values(&place, &provenance, &summary, rows.as_deref())?;
    let lock = create_empty(out)?;
    for name in [PROVENANCE, SUMMARY] {
        let from = run.join(name);
        let content = fs::read(&from).map_err(cannot_read(&from))?;
        replace(&out.join(name), |file| file.write_all(&content))?;
    }
    if let Some(rows) = &rows {
        rows_table::write(&out.join(ROWS_TABLE), rows)?;
    }
    let names = [PROVENANCE, SUMMARY].into_iter().chain(rows.is_some().then_some(ROWS_TABLE));
    let mut files = BTreeMap::new();
    for name in names {
        let path = out.join(name);
        let content = fs::read(&path).map_err(cannot_read(&path))?;
        files.insert(name.to_owned(), blake3::hash(&content).to_hex().to_string());
    }
    let simulators = provenance.simulators.iter().filter_map(|simulator| {
        let class = SimulatorClass::of(simulator, summary.simulators.get(&simulator.id)?);
        Some((simulator.id.clone(), class))
    });
    let record = ReferenceRecord {
        format: FORMAT.to_owned(),
        name: options.name.clone(),
        title: options.title().to_owned(),
        commands: options.commands.clone(),
        benchmark: provenance.benchmark.clone(),
        machine: MachineRecord::here(),
        files,
        simulators: simulators.collect(),
    };
    let text = toml::to_string_pretty(&record).expect("a reference holds text and finite numbers");
    replace(&out.join(REFERENCE_RECORD), |file| file.write_all(text.as_bytes()))?;
    drop(lock);
    Reference::open(out)
}
