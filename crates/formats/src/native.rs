//! The native format of this program: Parquet, one row per scenario. The columns are described in
//! `docs/files.md`.

mod by_number;
mod decode;
mod encode;

use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::crop::crop;
use super::error::{Cause, FormatError};
use super::format::{
    PendingScenarios, ScenarioFormat, UndecodedScenario, is_parquet, named, with_stated_frames,
};
use super::frames::{CurrentFrames, LengthChoice};
use super::table::{self, Batch, TableReader, TableWriter};
use reactsim_scene::{HISTORY, Scenario};

pub use by_number::{ByNumber, ids};

/// Value of `reactsim.format` in the metadata.
const KIND: &str = "reactsim-scenarios";
/// Version of the schema.
const VERSION: u32 = 1;
/// Number of scenarios in a row group, which a reader holds in memory.
const GROUP_SIZE: usize = 8;

/// The native format.
pub(super) struct Native;

impl ScenarioFormat for Native {
    fn id(&self) -> &'static str {
        "native"
    }

    fn title(&self) -> &'static str {
        "Parquet written by `reactsim convert`"
    }

    fn recognises(&self, path: &Path) -> bool {
        // By name if the file is too damaged to be recognised by its content.
        match is_parquet(path) {
            Ok(true) => table::kind(path).map_or(named(path, ".parquet"), |k| k.as_deref() == Some(KIND)),
            Ok(false) => named(path, ".parquet"),
            Err(_) => false,
        }
    }

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        let open = |step| -> Result<PendingScenarios, FormatError> {
            Ok(Box::new(Reader { length, step, ..Reader::over(path, TableReader::open(path)?)? }))
        };
        match frames {
            CurrentFrames::Every(step) => open(Some(step)),
            _ => with_stated_frames(self, path, frames, || open(None)),
        }
    }

    fn open_from(&self, path: &Path, first: usize) -> Result<PendingScenarios, FormatError> {
        Reader::from(path, TableReader::open(path)?, first)
    }

    fn count(&self, path: &Path) -> Option<usize> {
        Some(TableReader::open(path).ok()?.rows())
    }
}

/// Reads the content of a native file in memory, such as one embedded in the program, from the record
/// with the index `first` on; errors refer to it as `name`.
///
/// # Errors
/// [`FormatError`] if the content is not a native file.
pub fn read_bytes(
    name: &Path,
    content: &'static [u8],
    first: usize,
) -> Result<PendingScenarios, FormatError> {
    Reader::from(name, TableReader::of_bytes(name, content)?, first)
}

struct Reader {
    path: PathBuf,
    table: TableReader,
    /// Current rows and the index of the next one.
    rows: Option<(Arc<decode::Rows>, usize)>,
    /// Index of the next record.
    record: u64,
    length: LengthChoice,
    /// Frames between windows; `None` if scenarios are read as they are.
    step: Option<NonZeroUsize>,
    /// Current frames of further windows of the row that was read last.
    windows: VecDeque<usize>,
}

impl Reader {
    fn over(path: &Path, table: TableReader) -> Result<Self, FormatError> {
        table.require(KIND, VERSION)?;
        let (path, length) = (path.to_owned(), LengthChoice::default());
        Ok(Self { path, table, rows: None, record: 0, length, step: None, windows: VecDeque::new() })
    }

    /// Reads from the record with the index `first` on.
    fn from(path: &Path, table: TableReader, first: usize) -> Result<PendingScenarios, FormatError> {
        let mut reader = Self::over(path, table)?;
        let passed_over = reader.table.pass_over(first);
        reader.record = passed_over as u64;
        Ok(Box::new(reader.skip(first - passed_over)))
    }

    fn load(&mut self, batch: &Batch) -> Result<(), FormatError> {
        let rows = decode::Rows::new(batch).map_err(|cause| FormatError::file(&self.path, cause))?;
        self.rows = Some((Arc::new(rows), 0));
        Ok(())
    }
}

impl Iterator for Reader {
    type Item = Result<UndecodedScenario, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let (path, length) = (self.path.clone(), self.length);
            if let Some((rows, next)) = &self.rows
                && let Some(current) = self.windows.pop_front()
            {
                let (rows, row, record) = (Arc::clone(rows), next - 1, self.record - 1);
                return Some(Ok(UndecodedScenario::new(move || {
                    rows.window(row, &path, record, (current, length))
                })));
            }
            if let Some((rows, next)) = &mut self.rows
                && *next < rows.len()
            {
                let (rows, row, record) = (Arc::clone(rows), *next, self.record);
                *next += 1;
                self.record += 1;
                if let Some(step) = self.step {
                    self.windows = length.windows(rows.frames(row), step).collect();
                    continue;
                }
                return Some(Ok(UndecodedScenario::with_digest(move || {
                    let (mut scenario, digest) = rows.scenario(row, &path, record)?;
                    match crop(&mut scenario, length) {
                        Ok(()) => Ok((scenario, digest.filter(|_| length.is_default()))),
                        Err(cause) => Err(FormatError::record(&path, record, Some(scenario.id), cause)),
                    }
                })));
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

/// Writer of native files. The file gets its final name in [`Writer::finish`]; dropping the writer before
/// leaves no file.
pub struct Writer {
    path: PathBuf,
    table: TableWriter,
    columns: Optional,
}

/// Columns that a file has only if one of its scenarios needs them: the others have the bytes from before
/// these columns existed.
#[derive(Clone, Copy, Default, PartialEq)]
struct Optional {
    /// Those of heights, for scenarios of several levels.
    heights: bool,
    /// That of the number of frames up to the current one, for other numbers than that of the benchmark.
    history: bool,
}

impl Optional {
    /// Returns these columns and those that a scenario needs.
    fn with(self, scenario: &Scenario) -> Self {
        Self {
            heights: self.heights || scenario.start.has_levels(),
            history: self.history || scenario.length().history != HISTORY,
        }
    }
}

impl Writer {
    /// Starts a file under a temporary name in the same folder.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be created.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        let path = path.as_ref().to_owned();
        let columns = Optional::default();
        Ok(Self { table: create(&path, columns)?, path, columns })
    }

    /// Adds a scenario.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be written.
    pub fn write(&mut self, scenario: &Scenario) -> Result<(), FormatError> {
        let needed = self.columns.with(scenario);
        if needed != self.columns {
            self.add_columns(needed)?;
        }
        self.put(scenario)
    }

    fn put(&mut self, scenario: &Scenario) -> Result<(), FormatError> {
        encode::scenario(&mut self.table, scenario, self.columns);
        self.table.end_row()
    }

    /// Begins the file again with more columns, and copies what is written.
    fn add_columns(&mut self, columns: Optional) -> Result<(), FormatError> {
        let before = std::mem::replace(&mut self.table, create(&self.path, columns)?);
        self.columns = columns;
        for record in Reader::over(&self.path, before.read_back()?)? {
            self.put(&record.and_then(UndecodedScenario::decode)?)?;
        }
        Ok(())
    }

    /// Completes the file and gives it its final name.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be written.
    pub fn finish(self) -> Result<(), FormatError> {
        self.table.finish()
    }

    /// Completes the file as a part of what was to be written: an existing file stays, and the part gets a
    /// name next to it, which is returned (`a.interrupted.parquet` for `a.parquet`).
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be written.
    pub fn finish_part(self) -> Result<PathBuf, FormatError> {
        self.table.finish_part()
    }
}

fn create(path: &Path, columns: Optional) -> Result<TableWriter, FormatError> {
    TableWriter::create(path, (KIND, VERSION), GROUP_SIZE, encode::columns(columns))
}

/// Returns the error of an invalid cell.
fn wrong(column: &str, value: impl std::fmt::Display, expected: &str) -> Cause {
    Cause::value(format!("`{column}`"), value, expected)
}

#[cfg(test)]
mod tests;
