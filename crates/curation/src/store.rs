//! The file of a curation: Parquet, one row per candidate. Its format is described in
//! `docs/files.md`.
//!
//! It is a file of deviations ([`reactsim_formats::deviations`]): readers that need only the chosen
//! trajectories may ignore the other columns. A row group holds whole scenarios.

mod columns;
mod decode;
mod encode;
mod reader;
mod writer;

pub use reader::{Reader, read};
pub use writer::Writer;

use std::path::Path;

use super::CurationProvenance;
use reactsim_formats::FormatError;
use reactsim_formats::deviations::{KIND, VERSION};
use reactsim_formats::error::Cause;
use reactsim_formats::table::{FRAME, METADATA_CHECKSUM, TableReader};

/// Number of scenarios in a row group: a reader holds one group in memory.
const SCENARIOS_PER_GROUP: usize = 8;
/// Key of the file metadata that holds the provenance as JSON.
const PROVENANCE_KEY: &str = "reactsim.curation";
/// Value of the frame key: coordinates are relative to the scenario frame.
const SCENARIO_FRAME: &str = "scenario";

/// Opens a file and checks that a curation wrote it.
fn open(path: &Path) -> Result<(TableReader, CurationProvenance), FormatError> {
    let table = TableReader::open(path)?;
    table.require(KIND, VERSION)?;
    let provenance = provenance(&table).map_err(|cause| FormatError::file(path, cause))?;
    Ok((table, provenance))
}

fn provenance(table: &TableReader) -> Result<CurationProvenance, Cause> {
    let of = |key: &str| format!("`{key}` in the file's metadata");
    let missing = |key: &str| {
        let expected = "present, as in files that `reactsim curate` writes";
        Cause::schema(of(key), "missing", expected)
    };
    let text = table.key(PROVENANCE_KEY).ok_or_else(|| missing(PROVENANCE_KEY))?;
    table.key(METADATA_CHECKSUM).ok_or_else(|| missing(METADATA_CHECKSUM))?;
    match table.key(FRAME).ok_or_else(|| missing(FRAME))? {
        SCENARIO_FRAME => {}
        other => return Err(Cause::schema(of(FRAME), format!("`{other}`"), format!("`{SCENARIO_FRAME}`"))),
    }
    serde_json::from_str(text).map_err(|e| Cause::Undecodable(format!("{}: {e}", of(PROVENANCE_KEY))))
}
