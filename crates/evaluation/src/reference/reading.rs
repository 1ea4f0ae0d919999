//! Reading of a reference, with all checks that need only its files.

use std::path::Path;

use serde::de::DeserializeOwned;

use super::files::{Files, no_reference};
use super::record::FORMAT;
use super::{ReferenceError, ReferenceRecord, SimulatorClass};
use crate::folder::rows_table;
use crate::folder::tally_of;
use crate::layout::{PROVENANCE, REFERENCE_RECORD, ROWS_TABLE, SUMMARY};
use crate::provenance::Provenance;
use crate::provenance::leaves::differences;
use crate::row::Row;
use crate::summary::Summary;

/// A reference with consistent files.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Folder, for messages.
    pub place: String,
    /// Content of `reference.toml`.
    pub record: ReferenceRecord,
    /// Provenance of its run.
    pub provenance: Provenance,
    /// Result of its run.
    pub summary: Summary,
    /// All rows of its run; `None` if only aggregates are published.
    pub rows: Option<Vec<Row>>,
}

impl Reference {
    /// Reads the reference in a folder and checks it: no file is missing, extra or changed, and the rows give
    /// the summary, with all scenarios and simulators.
    ///
    /// # Errors
    /// [`ReferenceError`] names the file and what is wrong.
    pub fn open(folder: &Path) -> Result<Self, ReferenceError> {
        Self::read(Files::of_folder(folder)?)
    }

    /// Like [`Self::open`], for a reference that is embedded in the program; `None` if there is none with
    /// this name.
    ///
    /// # Errors
    /// [`ReferenceError`] for inconsistent files; a test ensures that there are none.
    pub fn embedded(name: &str) -> Option<Result<Self, ReferenceError>> {
        Files::embedded(name).map(Self::read)
    }

    fn read(mut files: Files) -> Result<Self, ReferenceError> {
        let place = files.place.clone();
        let record = take_record(&mut files)?;
        check_files(&record, &files)?;
        let provenance: Provenance = json(&files, PROVENANCE)?;
        let summary: Summary = json(&files, SUMMARY)?;
        let rows = match files.content.remove(ROWS_TABLE) {
            Some(content) => Some(rows_table::read_bytes(&Path::new(&place).join(ROWS_TABLE), content)?),
            None => None,
        };
        let reference = Self { place, record, provenance, summary, rows };
        reference.check()?;
        Ok(reference)
    }

    /// Checks that the files are consistent.
    fn check(&self) -> Result<(), ReferenceError> {
        let record = &self.record;
        self.agree((REFERENCE_RECORD, &record.benchmark), (PROVENANCE, &self.provenance.benchmark))?;
        let classes =
            record.simulators.iter().map(|(id, class)| (id.clone(), *class == SimulatorClass::Exact));
        let networks = self.provenance.simulators.iter().map(|s| (s.id.clone(), !s.is_network()));
        let (mut classes, mut networks): (Vec<_>, Vec<_>) = (classes.collect(), networks.collect());
        classes.sort();
        networks.sort();
        self.agree((REFERENCE_RECORD, &classes), (PROVENANCE, &networks))?;
        for (id, class) in &record.simulators {
            let metrics = self.summary.simulators.get(id).map(|s| &s.metrics);
            if let Some(wrong) = metrics.and_then(|metrics| class.wrong_bound(metrics)) {
                let reason = format!("reference.toml: `{id}`: {wrong}");
                return Err(ReferenceError::unfit(&self.place, reason));
            }
        }
        check_values(&self.place, &self.provenance, &self.summary, self.rows.as_deref())
    }

    fn agree<T: serde::Serialize>(
        &self,
        (first, a): (&'static str, &T),
        (second, b): (&'static str, &T),
    ) -> Result<(), ReferenceError> {
        agree(&self.place, (first, a), (second, b))
    }
}

/// Parses a JSON file.
fn json<T: DeserializeOwned>(files: &Files, file: &str) -> Result<T, ReferenceError> {
    let damaged = |error| ReferenceError::Unfit(format!("{}/{file} cannot be read: {error}", files.place));
    serde_json::from_slice(&files.content[file]).map_err(damaged)
}

/// Checks that two files of a folder have equal values.
fn agree<T: serde::Serialize>(
    place: &str,
    (first, a): (&'static str, &T),
    (second, b): (&'static str, &T),
) -> Result<(), ReferenceError> {
    match differences(a, b).into_iter().next() {
        None => Ok(()),
        Some((field, stated, found)) => {
            let files = format!("{first} and {second}");
            let reason = format!("{files} do not agree: `{field}` is {stated} and {found}");
            Err(ReferenceError::unfit(place, reason))
        }
    }
}

/// Checks that a run is complete: finished without a failure, on all scenarios of its benchmark, with the
/// summary that follows from its rows.
///
/// # Errors
/// [`ReferenceError`] names what is missing or different.
pub fn check_values(
    place: &str,
    provenance: &Provenance,
    summary: &Summary,
    rows: Option<&[Row]>,
) -> Result<(), ReferenceError> {
    let unfit = |reason: String| Err(ReferenceError::unfit(place, reason));
    let stated = Provenance { keep_rollouts: None, ..provenance.clone() };
    agree(place, (PROVENANCE, &stated), (SUMMARY, &summary.provenance.run))?;
    let found = &summary.provenance;
    if let Some(failure) = found.failures.first() {
        return unfit(format!("the run has {} failures, the first: {}", found.failures.len(), failure.error));
    }
    let known = stated.benchmark.as_ref().and_then(|benchmark| benchmark.known());
    let expected = known.as_ref().map_or(found.scenarios, |known| known.scenarios);
    for (id, scenarios) in [("the run", found.scenarios)]
        .into_iter()
        .chain(summary.simulators.iter().map(|(id, simulator)| (id.as_str(), simulator.scenarios)))
    {
        if scenarios != expected {
            let of = known.as_ref().map_or_else(|| "the run".to_owned(), |known| known.record.to_string());
            return unfit(format!("{id} has {scenarios} of the {expected} scenarios of {of}"));
        }
    }
    let Some(rows) = rows else { return Ok(()) };
    let (tally, dropped) = tally_of(&stated, rows);
    if let Some((scenario, simulator)) = dropped {
        return unfit(format!("the rows of `{scenario}` with `{simulator}` are incomplete"));
    }
    let mut again = Summary::new(&tally, &[], &stated);
    // Skipped scenarios have no rows.
    again.provenance.passed_over = found.passed_over;
    again.provenance.unused_deviations = found.unused_deviations;
    // A program of a later version has more metrics.
    again.restrict_to(&Row::metrics_of(rows).into_iter().chain(summary.metrics()).collect());
    agree(place, (SUMMARY, summary), ("the rows", &again))
}

/// Removes `reference.toml` from the files and parses it.
fn take_record(files: &mut Files) -> Result<ReferenceRecord, ReferenceError> {
    let place = files.place.clone();
    let Some(content) = files.content.remove(REFERENCE_RECORD) else {
        return Err(no_reference(&place));
    };
    let text = String::from_utf8_lossy(&content);
    let damaged = |error| ReferenceError::Unfit(format!("{place}/reference.toml cannot be read: {error}"));
    let record: ReferenceRecord = toml::from_str(&text).map_err(damaged)?;
    if record.format == FORMAT {
        return Ok(record);
    }
    let reason = format!("reference.toml has the format `{}`, this program reads `{FORMAT}`", record.format);
    Err(ReferenceError::unfit(&place, reason))
}

/// Checks that no file is missing, extra or changed.
fn check_files(record: &ReferenceRecord, files: &Files) -> Result<(), ReferenceError> {
    let unfit = |reason: String| Err(ReferenceError::unfit(&files.place, reason));
    for file in [PROVENANCE, SUMMARY] {
        if !record.files.contains_key(file) {
            return unfit(format!("the file {file} is missing"));
        }
    }
    for (file, stated) in &record.files {
        if ![PROVENANCE, SUMMARY, ROWS_TABLE].contains(&file.as_str()) {
            return unfit(format!("reference.toml lists {file}, which no reference has"));
        }
        let Some(content) = files.content.get(file) else {
            return unfit(format!("the file {file} is missing"));
        };
        let found = blake3::hash(content).to_hex().to_string();
        if found != *stated {
            return unfit(format!(
                "{file} was changed: its digest is {found}, in reference.toml it is {stated}"
            ));
        }
    }
    match files.content.keys().find(|file| !record.files.contains_key(*file)) {
        Some(file) => unfit(format!(
            "the file {file} does not belong to the reference: reference.toml does not list it"
        )),
        None => Ok(()),
    }
}
