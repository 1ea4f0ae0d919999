//! Sequential reading of a curation file.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use reactsim_formats::{FormatError, error::Cause, table::TableReader};

use super::decode::Rows;
use super::open;
use crate::{CurationProvenance, ScenarioRecord};

/// Reads the scenarios of a curation in file order, with one row group in memory at a time. The first
/// error ends the sequence.
///
/// # Errors
/// [`FormatError`] when the file cannot be read or was not written by a curation.
pub fn read(path: impl AsRef<Path>) -> Result<Reader, FormatError> {
    let path = path.as_ref();
    let (table, provenance) = open(path)?;
    Ok(Reader {
        path: path.to_owned(),
        table,
        provenance,
        group: 0,
        records: Vec::new().into_iter(),
        ids: BTreeSet::new(),
    })
}

/// Iterator over the scenarios of a file.
pub struct Reader {
    path: PathBuf,
    table: TableReader,
    provenance: CurationProvenance,
    group: usize,
    records: std::vec::IntoIter<ScenarioRecord>,
    ids: BTreeSet<String>,
}

impl Reader {
    /// Returns the provenance of the file.
    pub fn provenance(&self) -> &CurationProvenance {
        &self.provenance
    }

    fn load(&mut self) -> Result<(), FormatError> {
        let batch = self.table.group(self.group, &[])?;
        let records = Rows::new(&batch).records().map_err(|cause| FormatError::file(&self.path, cause))?;
        for record in &records {
            let fresh = self.ids.insert(record.scenario_id.clone());
            fresh.then_some(()).ok_or_else(|| repeated(&self.path, &record.scenario_id))?;
        }
        self.records = records.into_iter();
        Ok(())
    }
}

/// Returns the error for a scenario whose rows are not contiguous.
fn repeated(path: &Path, id: &str) -> FormatError {
    let cause = Cause::value("`scenario_id`", format!("`{id}` again"), "the rows of a scenario together");
    FormatError::file(path, cause)
}

impl Iterator for Reader {
    type Item = Result<ScenarioRecord, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(record) = self.records.next() {
                return Some(Ok(record));
            }
            if self.group >= self.table.groups() {
                return None;
            }
            let loaded = self.load();
            self.group += 1;
            if let Err(error) = loaded {
                self.group = self.table.groups();
                return Some(Err(error));
            }
        }
    }
}
