//! Reading the file of a curation from its beginning to its end.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::decode::Rows;
use super::open;
use crate::curation::{CurationProvenance, ScenarioRecord};
use crate::formats::FormatError;
use crate::formats::error::Cause;
use crate::formats::table::TableReader;

/// Reads the scenarios of a curation in file order, one row group in memory at a time. After an error there is nothing more.
///
/// # Errors
/// [`FormatError`] when the file can not be read or no curation wrote it.
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

/// The scenarios of a file.
pub struct Reader {
    path: PathBuf,
    table: TableReader,
    provenance: CurationProvenance,
    group: usize,
    records: std::vec::IntoIter<ScenarioRecord>,
    ids: BTreeSet<String>,
}

impl Reader {
    /// Where the file comes from.
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

/// The refusal of a scenario whose rows do not lie together.
pub(super) fn repeated(path: &Path, id: &str) -> FormatError {
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
