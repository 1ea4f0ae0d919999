//! The file of a curation: Parquet, one row per candidate. Told in `scenarios/README.md`.
//!
//! It is a file of deviations ([`crate::formats::deviations`]): whoever wants the chosen trajectories only need not know what else
//! is in it. A row group holds whole scenarios, so that one scenario is read without the others.

mod columns;
mod decode;
mod encode;
mod index;
mod reader;
mod writer;

pub use index::{CandidateEntry, ScenarioEntry, Store};
pub use reader::{Reader, read};
pub use writer::Writer;

use std::path::Path;

use super::CurationProvenance;
use crate::formats::FormatError;
use crate::formats::deviations::{KIND, VERSION};
use crate::formats::error::Cause;
use crate::formats::table::{FRAME, METADATA_CHECKSUM, TableReader};

/// Scenarios in a row group: what a reader holds in memory, and what the review page decodes for one scenario.
const GROUP: usize = 8;
/// Key of the file's metadata with the provenance, as JSON.
const PROVENANCE: &str = "reactsim.curation";
/// What coordinates are relative to.
const SCENARIO_FRAME: &str = "scenario";

/// Opens a file and makes sure that a curation wrote it.
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
    let text = table.key(PROVENANCE).ok_or_else(|| missing(PROVENANCE))?;
    table.key(METADATA_CHECKSUM).ok_or_else(|| missing(METADATA_CHECKSUM))?;
    match table.key(FRAME).ok_or_else(|| missing(FRAME))? {
        SCENARIO_FRAME => {}
        other => return Err(Cause::schema(of(FRAME), format!("`{other}`"), format!("`{SCENARIO_FRAME}`"))),
    }
    serde_json::from_str(text).map_err(|e| Cause::Undecodable(format!("{}: {e}", of(PROVENANCE))))
}
