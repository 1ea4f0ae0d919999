//! Reading scenarios of a native file in any order.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::decode::Rows;
use super::{KIND, VERSION};
use crate::formats::error::{Cause, FormatError};
use crate::formats::table::{Leaf, TableReader, View};
use crate::scene::Scenario;

/// A native file whose scenarios are read by number, by several threads. In memory are the names of the scenarios, and the row groups of
/// those that are being read.
pub struct ByNumber {
    path: PathBuf,
    entries: Vec<Entry>,
    /// Open files that no thread reads from just now.
    readers: Mutex<Vec<TableReader>>,
}

/// A scenario and its place.
struct Entry {
    id: String,
    digest: String,
    group: usize,
    row: usize,
}

impl ByNumber {
    /// Opens a file and reads the names of its scenarios; the checksums of all row groups are checked.
    ///
    /// # Errors
    /// [`FormatError`] when it is no native file, or damaged.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let mut table = open(path)?;
        let refuse = |cause| FormatError::file(path, cause);
        let mut entries = Vec::new();
        for group in 0..table.groups() {
            let batch = table.group(group, &["id", "digest"])?;
            let id = View::need(&batch, "id", Leaf::Text, 0).map_err(refuse)?;
            let digest = View::need(&batch, "digest", Leaf::Text, 0).map_err(refuse)?;
            for row in 0..batch.num_rows() {
                let text = |view: &View| {
                    view.text(row).map(str::to_owned).ok_or_else(|| {
                        refuse(Cause::value(
                            format!("`{}` of row {}", view.name(), entries.len()),
                            "null",
                            "a text",
                        ))
                    })
                };
                entries.push(Entry { id: text(&id)?, digest: text(&digest)?, group, row });
            }
        }
        Ok(Self { path: path.to_owned(), entries, readers: Mutex::new(vec![table]) })
    }

    /// The number of scenarios.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The name of a scenario.
    pub fn id(&self, number: usize) -> &str {
        &self.entries[number].id
    }

    /// The digest that the file states for a scenario; reading checks it.
    pub fn digest(&self, number: usize) -> &str {
        &self.entries[number].digest
    }

    /// Reads a scenario.
    ///
    /// # Errors
    /// [`FormatError`] when the file changed meanwhile, can not be read any more, or the scenario is damaged.
    pub fn read(&self, number: usize) -> Result<Scenario, FormatError> {
        let entry = &self.entries[number];
        let idle = self.readers.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut table = idle.map_or_else(|| open(&self.path), Ok)?;
        let changed = |found: String| {
            let expected = "what it held when it was opened: it was changed meanwhile";
            FormatError::file(&self.path, Cause::value("the content of the file", found, expected))
        };
        if entry.group >= table.groups() {
            return Err(changed(format!("{} row groups", table.groups())));
        }
        let batch = table.group(entry.group, &[])?;
        self.readers.lock().unwrap_or_else(PoisonError::into_inner).push(table);
        let rows = Rows::new(&batch).map_err(|cause| FormatError::file(&self.path, cause))?;
        if entry.row >= rows.len() {
            return Err(changed(format!("a row group of {} rows", rows.len())));
        }
        let scenario = rows.scenario(entry.row, &self.path, number as u64)?;
        // The row holds to its own digest; it must be the one that was there before.
        if scenario.id == entry.id && rows.digest(entry.row) == Some(&entry.digest) {
            return Ok(scenario);
        }
        Err(changed(format!("scenario `{}` in the place of `{}`", scenario.id, entry.id)))
    }
}

fn open(path: &Path) -> Result<TableReader, FormatError> {
    let table = TableReader::open(path)?;
    table.require(KIND, VERSION)?;
    Ok(table)
}
