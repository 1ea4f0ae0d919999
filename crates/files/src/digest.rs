//! Digests of files.

use std::io;
use std::path::Path;

use super::open_regular;

/// Size and digest of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileDigest {
    /// Size, bytes.
    pub bytes: u64,
    /// BLAKE3 digest of the content, 64 hexadecimal digits.
    pub blake3: String,
}

/// Reads a file to its end for its size and digest.
///
/// # Errors
/// The error of the system; also if the path is not a regular file.
pub fn digest(path: &Path) -> io::Result<FileDigest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(open_regular(path)?)?;
    Ok(FileDigest { bytes: hasher.count(), blake3: hasher.finalize().to_hex().to_string() })
}
