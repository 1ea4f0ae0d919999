//! Writing of a curation file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use reactsim_formats::{FormatError, error::Cause, table::TableWriter};

use super::{FRAME, KIND, PROVENANCE_KEY, SCENARIO_FRAME, SCENARIOS_PER_GROUP, VERSION, columns, encode};
use crate::{CurationProvenance, ScenarioRecord};

/// Writes a curation. The file gets its name when it is finished; a writer that is dropped leaves
/// nothing.
pub struct Writer {
    path: PathBuf,
    table: TableWriter,
    ids: BTreeSet<String>,
    /// Number of scenarios in the current row group.
    waiting: usize,
    written: u64,
}

impl Writer {
    /// Creates a file, under a temporary name in the same folder.
    ///
    /// # Errors
    /// [`FormatError`] when the file cannot be created.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        let path = path.as_ref();
        // Row groups must end with a scenario, so the table must not end them by itself.
        let table = TableWriter::create(path, (KIND, VERSION), usize::MAX, columns::columns())?;
        Ok(Self { path: path.to_owned(), table, ids: BTreeSet::new(), waiting: 0, written: 0 })
    }

    /// Adds a scenario with its candidates. Returns whether it is now in the file: a scenario without
    /// candidates has no rows and appears only in the counts.
    ///
    /// # Errors
    /// [`FormatError`] when the file cannot be written, when the scenario is already in it, or when a
    /// track does not have as many states as the others of its scenario.
    pub fn write(&mut self, record: &ScenarioRecord) -> Result<bool, FormatError> {
        if record.candidates.is_empty() {
            return Ok(false);
        }
        self.check(record).map_err(|cause| {
            FormatError::record(&self.path, self.written, Some(record.scenario_id.clone()), cause)
        })?;
        self.ids.insert(record.scenario_id.clone());
        for (i, candidate) in record.candidates.iter().enumerate() {
            encode::candidate(&mut self.table, record, candidate, i == 0);
            self.table.end_row()?;
        }
        self.written += 1;
        self.waiting += 1;
        if self.waiting >= SCENARIOS_PER_GROUP {
            self.waiting = 0;
            self.table.flush()?;
        }
        Ok(true)
    }

    /// Rejects records that could not be read back.
    fn check(&self, record: &ScenarioRecord) -> Result<(), Cause> {
        let id = &record.scenario_id;
        if self.ids.contains(id) {
            return Err(Cause::value("scenario_id", format!("`{id}` again"), "every scenario once"));
        }
        // The writer receives scenarios with candidates only.
        let all = record.candidates.first().map_or(0, |one| one.candidate.track.len());
        let expected = || format!("{all} states");
        let wrong = |what: String, n: usize| Cause::value(what, format!("{n} states"), expected());
        for one in &record.candidates {
            let (n, states) = (one.candidate.number, one.candidate.track.len());
            if states != all {
                return Err(wrong(format!("the track of candidate {n}"), states));
            }
            let mut responses = one.certificate.iter().flat_map(|c| &c.responses);
            if let Some(response) = responses.find(|r| r.track.len() != all) {
                let what = format!("the response of agent `{}` to candidate {n}", response.agent);
                return Err(wrong(what, response.track.len()));
            }
        }
        Ok(())
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// [`FormatError`] when the file cannot be written.
    ///
    /// # Panics
    /// Never: a provenance is text and whole numbers.
    pub fn finish(mut self, provenance: &CurationProvenance) -> Result<(), FormatError> {
        self.describe(provenance);
        self.table.finish()
    }

    /// Completes the file as a part of what was to be written: an existing file stays, and the part gets a
    /// name next to it, which is returned (`a.interrupted.parquet` for `a.parquet`).
    ///
    /// # Errors
    /// [`FormatError`] when the file cannot be written.
    pub fn finish_part(mut self, provenance: &CurationProvenance) -> Result<PathBuf, FormatError> {
        self.describe(provenance);
        self.table.finish_part()
    }

    fn describe(&mut self, provenance: &CurationProvenance) {
        let text = serde_json::to_string(provenance).expect("a provenance is text and whole numbers");
        self.table.add_metadata(FRAME, SCENARIO_FRAME.to_owned());
        self.table.add_metadata(PROVENANCE_KEY, text);
    }
}
