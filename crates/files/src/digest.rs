//! Digests of files.

use std::io::{self, Read};
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
    let mut file = open_regular(path)?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 18];
    let mut bytes = 0;
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(FileDigest { bytes, blake3: hasher.finalize().to_hex().to_string() }),
            n => {
                bytes += n as u64;
                hasher.update(&buffer[..n]);
            }
        }
    }
}
