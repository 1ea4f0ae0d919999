//! Parquet files of this program: written under another name until they are complete, with a checksum per row group.

mod columns;
mod compact;
mod pages;
mod reader;
mod writer;

pub(crate) use columns::{Column, Leaf, Value, View};
pub(crate) use reader::{TableReader, kind};
pub(crate) use writer::TableWriter;

/// Key of the file's metadata that says what the file holds.
pub(crate) const KIND: &str = "reactsim.format";
/// Key of the version of the schema.
pub(crate) const VERSION: &str = "reactsim.version";
/// Key that says which frame coordinates are in: `world` (default) or `scenario`.
pub(crate) const FRAME: &str = "reactsim.frame";
/// Key of the checksums: per row group `start:end:rows:crc32c`, separated by commas.
const SUMS: &str = "reactsim.row_groups";
/// Key of the checksum of what a file's metadata say of its content, in files that say more than kind and version.
pub(crate) const SAID: &str = "reactsim.metadata";
/// Most rows of a row group that is read at once.
const LARGEST_GROUP: usize = 1 << 16;

/// Checksum of keys with their values, in this order: the keys too, so that none can be lost.
fn sum<'a>(said: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let mut keys = Vec::new();
    let mut sum = 0;
    for (key, value) in said {
        for part in [key, "\0", value, "\0"] {
            sum = crc32c::crc32c_append(sum, part.as_bytes());
        }
        keys.push(key);
    }
    format!("{sum:08x} {}", keys.join(" "))
}
