//! The scenarios of a partition, in a file that is there only if it has any.

use std::path::{Path, PathBuf};

use crate::formats::native::Writer;
use crate::formats::{self, FormatError, Scenarios};
use crate::scene::Scenario;

/// Name of the file.
const SCENARIOS: &str = "scenarios.parquet";

/// Writes the scenarios of a partition. A file without scenarios could not be read back.
pub(super) struct ScenarioFile {
    path: PathBuf,
    writer: Option<Writer>,
}

impl ScenarioFile {
    pub(super) fn new(folder: &Path) -> Self {
        Self { path: folder.join(SCENARIOS), writer: None }
    }

    pub(super) fn write(&mut self, scenario: &Scenario) -> Result<(), FormatError> {
        let writer = match &mut self.writer {
            Some(writer) => writer,
            none => none.insert(Writer::create(&self.path)?),
        };
        writer.write(scenario)
    }

    /// Completes the file, if there is one.
    pub(super) fn finish(self) -> Result<(), FormatError> {
        self.writer.map_or(Ok(()), Writer::finish)
    }
}

/// Reads the scenarios of a partition.
pub(super) fn read_scenarios(folder: &Path) -> Result<Scenarios, FormatError> {
    let path = folder.join(SCENARIOS);
    if path.exists() { formats::open(&path) } else { Ok(Box::new(std::iter::empty())) }
}
