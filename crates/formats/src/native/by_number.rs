//! Random access to the scenarios of a native file.

use std::path::{Path, PathBuf};

use parking_lot::Mutex;
use reactsim_scene::Scenario;

use super::decode::Rows;
use super::{KIND, VERSION};
use crate::error::{Cause, FormatError};
use crate::table::{Leaf, TableReader, View};

/// Native file with random access to scenarios by index, for several threads. Only the ids of the scenarios
/// and the row groups in use are in memory.
pub struct ByNumber {
    path: PathBuf,
    entries: Vec<Entry>,
    /// Open readers that no thread is using.
    idle_readers: Mutex<Vec<TableReader>>,
}

/// Id, digest and position of a scenario.
struct Entry {
    id: String,
    digest: String,
    group: usize,
    row: usize,
}

impl ByNumber {
    /// Opens a file, reads the ids of its scenarios and checks the checksums of all row groups.
    ///
    /// # Errors
    /// [`FormatError`] if the file is not a native file or is damaged.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let mut table = open(path)?;
        let entries = entries(path, &mut table)?;
        Ok(Self { path: path.to_owned(), entries, idle_readers: Mutex::new(vec![table]) })
    }

    /// Returns the number of scenarios.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Returns whether there are no scenarios.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Returns the id of a scenario.
    pub fn id(&self, number: usize) -> &str {
        &self.entries[number].id
    }

    /// Returns the digest stored for a scenario; [`ByNumber::read`] checks it.
    pub fn digest(&self, number: usize) -> &str {
        &self.entries[number].digest
    }

    /// Reads a scenario.
    ///
    /// # Errors
    /// [`FormatError`] if the file has changed or cannot be read any more, or if the scenario is damaged.
    pub fn read(&self, number: usize) -> Result<Scenario, FormatError> {
        let entry = &self.entries[number];
        let idle = self.idle_readers.lock().pop();
        let mut table = idle.map_or_else(|| open(&self.path), Ok)?;
        let changed = |found: String| {
            let expected = "the content at opening; the file has changed since";
            FormatError::file(&self.path, Cause::value("the content of the file", found, expected))
        };
        if entry.group >= table.groups() {
            return Err(changed(format!("{} row groups", table.groups())));
        }
        let batch = table.group(entry.group, &[])?;
        self.idle_readers.lock().push(table);
        let rows = Rows::new(&batch).map_err(|cause| FormatError::file(&self.path, cause))?;
        if entry.row >= rows.len() {
            return Err(changed(format!("a row group of {} rows", rows.len())));
        }
        let (scenario, _) = rows.scenario(entry.row, &self.path, number as u64)?;
        // The row matches its own digest, which must also be the digest at opening.
        if scenario.id == entry.id && rows.digest(entry.row) == Some(&entry.digest) {
            return Ok(scenario);
        }
        Err(changed(format!("scenario `{}` in place of `{}`", scenario.id, entry.id)))
    }
}

/// Returns the ids of all scenarios of a file in memory.
///
/// # Errors
/// [`FormatError`] if the content is not a native file or is damaged.
pub fn ids(name: &Path, content: &'static [u8]) -> Result<Vec<String>, FormatError> {
    let mut table = TableReader::of_bytes(name, content)?;
    table.require(KIND, VERSION)?;
    Ok(entries(name, &mut table)?.into_iter().map(|entry| entry.id).collect())
}

/// Reads ids and digests of all scenarios, and checks the checksums of all row groups.
fn entries(path: &Path, table: &mut TableReader) -> Result<Vec<Entry>, FormatError> {
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
    Ok(entries)
}

fn open(path: &Path) -> Result<TableReader, FormatError> {
    let table = TableReader::open(path)?;
    table.require(KIND, VERSION)?;
    Ok(table)
}
