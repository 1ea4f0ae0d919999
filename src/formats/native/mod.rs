//! The program's own format: Parquet, one row per scenario. The columns are told in `scenarios/README.md`.

mod by_number;
mod decode;
mod encode;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::RecordBatch;

use super::error::{Cause, FormatError};
use super::format::{PendingScenarios, ScenarioFormat, Scenarios, Undecoded, is_parquet, named};
use super::table::{self, TableReader, TableWriter};
use crate::scene::Scenario;

pub use by_number::ByNumber;

/// What the file's metadata call the content.
const KIND: &str = "reactsim-scenarios";
/// Version of the schema.
const VERSION: u32 = 1;
/// Scenarios in a row group: what a reader holds in memory.
const GROUP: usize = 8;

/// The format.
pub(super) struct Native;

impl ScenarioFormat for Native {
    fn id(&self) -> &'static str {
        "native"
    }

    fn title(&self) -> &'static str {
        "Parquet written by `reactsim convert`"
    }

    fn recognises(&self, path: &Path) -> bool {
        // By name where the file is too damaged to tell by its content.
        match is_parquet(path) {
            Ok(true) => table::kind(path).map_or(named(path, ".parquet"), |k| k.as_deref() == Some(KIND)),
            Ok(false) => named(path, ".parquet"),
            Err(_) => false,
        }
    }

    fn open(&self, path: &Path) -> Result<Scenarios, FormatError> {
        let records = Reader::over(path, TableReader::open(path)?)?;
        Ok(Box::new(records.map(|record| record.and_then(|decode| decode()))))
    }

    fn open_undecoded(&self, path: &Path) -> Result<PendingScenarios, FormatError> {
        Ok(Box::new(Reader::over(path, TableReader::open(path)?)?))
    }
}

/// Reads the content of a native file that is in memory, such as one that is part of the program; errors name it by `name`.
///
/// # Errors
/// [`FormatError`] when it is no native file.
pub fn read_bytes(name: &Path, content: &'static [u8]) -> Result<PendingScenarios, FormatError> {
    Ok(Box::new(Reader::over(name, TableReader::of_bytes(name, content)?)?))
}

struct Reader {
    path: PathBuf,
    table: TableReader,
    rows: Option<(Arc<decode::Rows>, usize)>,
    record: u64,
}

impl Reader {
    fn over(path: &Path, table: TableReader) -> Result<Self, FormatError> {
        table.require(KIND, VERSION)?;
        Ok(Self { path: path.to_owned(), table, rows: None, record: 0 })
    }

    fn load(&mut self, batch: &RecordBatch) -> Result<(), FormatError> {
        let rows = decode::Rows::new(batch).map_err(|cause| FormatError::file(&self.path, cause))?;
        self.rows = Some((Arc::new(rows), 0));
        Ok(())
    }
}

impl Iterator for Reader {
    type Item = Result<Undecoded, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some((rows, next)) = &mut self.rows
                && *next < rows.len()
            {
                let (rows, row, path, record) = (Arc::clone(rows), *next, self.path.clone(), self.record);
                *next += 1;
                self.record += 1;
                return Some(Ok(Box::new(move || rows.scenario(row, &path, record))));
            }
            let loaded = match self.table.next_batch()? {
                Ok(batch) => self.load(&batch),
                Err(error) => Err(error),
            };
            if let Err(error) = loaded {
                self.rows = None;
                self.table.end();
                return Some(Err(error.at(self.record)));
            }
        }
    }
}

/// Writes scenarios to a native file. The file gets its name when it is finished; a writer that is dropped leaves nothing.
pub struct Writer {
    table: TableWriter,
}

impl Writer {
    /// Begins a file, under another name in the same folder.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be created.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        Ok(Self { table: TableWriter::create(path.as_ref(), (KIND, VERSION), GROUP, encode::columns())? })
    }

    /// Adds a scenario.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be written.
    pub fn write(&mut self, scenario: &Scenario) -> Result<(), FormatError> {
        encode::scenario(&mut self.table, scenario);
        self.table.end_row()
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be written.
    pub fn finish(self) -> Result<(), FormatError> {
        self.table.finish()
    }
}

/// The refusal of a cell.
fn wrong(column: &str, value: impl std::fmt::Display, expected: &str) -> Cause {
    Cause::value(format!("`{column}`"), value, expected)
}
