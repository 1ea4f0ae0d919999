//! Parquet files of this program: written under another name until they are complete, with a checksum per row group.

mod columns;
mod reader;
mod writer;

pub(super) use columns::{Column, Leaf, Value, View};
pub(super) use reader::{TableReader, kind};
pub(super) use writer::TableWriter;

/// Key of the file's metadata that says what the file holds.
pub(super) const KIND: &str = "reactsim.format";
/// Key of the version of the schema.
pub(super) const VERSION: &str = "reactsim.version";
/// Key of the checksums: per row group `start:end:rows:crc32c`, separated by commas.
const SUMS: &str = "reactsim.row_groups";
