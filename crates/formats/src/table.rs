//! Parquet files of this program: written under a temporary name until they are complete, with a checksum per
//! row group.

mod batch;
mod columns;
mod compact;
mod footer;
mod group;
mod pages;
mod reader;
mod writer;

pub use batch::Batch;
pub use columns::{Column, Leaf, Value, View};
pub use reader::{TableReader, kind};
pub use writer::TableWriter;

use parquet::basic::{Compression, ZstdLevel};
use parquet::file::properties::{WriterProperties, WriterPropertiesBuilder};

/// Metadata key of the kind of file.
pub const KIND: &str = "reactsim.format";
/// Metadata key of the version of the schema.
pub const VERSION: &str = "reactsim.version";
/// Metadata key of the coordinate frame: `world` (default) or `scenario`.
pub const FRAME: &str = "reactsim.frame";
/// Metadata key of the checksums: for each row group `start:end:rows:crc32c`, separated by commas.
const GROUP_CHECKSUMS: &str = "reactsim.row_groups";
/// Metadata key of the checksum of the other metadata, in files with more metadata than kind and version.
pub const METADATA_CHECKSUM: &str = "reactsim.metadata";
/// Maximum number of rows of a row group that is read at once.
const MAX_GROUP_ROWS: usize = 1 << 16;

/// Returns the properties of every Parquet file that this program writes.
pub fn properties() -> WriterPropertiesBuilder {
    WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_created_by(format!("reactsim {}", env!("CARGO_PKG_VERSION")))
}

/// Returns the checksum of keys and values in this order, followed by the list of keys, so that no key can be
/// lost.
fn metadata_checksum<'a>(entries: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut keys = Vec::new();
    let mut sum = 0;
    for (key, value) in entries {
        for part in [key, "\0", value, "\0"] {
            sum = crc32c::crc32c_append(sum, part.as_bytes());
        }
        keys.push(key);
    }
    format!("{sum:08x} {}", keys.join(" "))
}
