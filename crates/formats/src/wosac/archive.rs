//! The files of a tar archive, one after another, from a stream.
//!
//! The iterator of the crate `tar` borrows its archive, so that a reader cannot own both. Headers are
//! therefore read here, with the crate's types.

use std::io::{self, Read};

use tar::Header;

use crate::error::Cause;

/// Size of the blocks of an archive in bytes.
pub(super) const BLOCK: usize = 512;
/// Maximum length of an extended header, which holds long names, in bytes.
const MAX_EXTENSION_LENGTH: u64 = 1 << 16;
/// Maximum length of the padding behind the last file in bytes; `tar` writes records of 10 KiB.
const MAX_PADDING: u64 = 1 << 20;
/// Position and length of the checksum in a header.
const CHECKSUM: std::ops::Range<usize> = 148..156;
/// Position of the name of the format in a header, and this name.
const MAGIC: (std::ops::Range<usize>, &[u8]) = (257..262, b"ustar");

/// Reader of a tar archive. It reads as the current file.
pub(super) struct Archive {
    source: Box<dyn Read + Send>,
    /// Bytes of the current file that are left.
    left: u64,
    /// Bytes between the end of the current file and the next header.
    padding: u64,
}

impl Archive {
    pub(super) fn new(source: Box<dyn Read + Send>) -> Self {
        Self { source, left: 0, padding: 0 }
    }

    /// Goes to the next file and returns its path; `None` at the end of the archive. Folders are passed over.
    ///
    /// # Errors
    /// The archive is damaged; no other file can be found in it.
    pub(super) fn next_file(&mut self) -> Result<Option<String>, Cause> {
        let (mut long_name, mut long_size) = (None, None);
        loop {
            let rest = self.left + self.padding;
            let skipped =
                io::copy(&mut (&mut self.source).take(rest), &mut io::sink()).map_err(Cause::read)?;
            if skipped < rest {
                return Err(Cause::Truncated { what: "the archive", found: skipped, expected: rest });
            }
            (self.left, self.padding) = (0, 0);
            let Some(header) = self.header()? else { return self.end().map(|()| None) };
            let stated = header.entry_size().map_err(|_| damaged("the size of a file is no number"))?;
            let kind = header.entry_type();
            let is_extension = kind.is_gnu_longname() || kind.is_pax_local_extensions();
            let size = if is_extension { stated } else { long_size.take().unwrap_or(stated) };
            let blocks = size.div_ceil(BLOCK as u64).checked_mul(BLOCK as u64);
            let padded = blocks.ok_or_else(|| damaged("a file is longer than any disk"))?;
            (self.left, self.padding) = (size, padded - size);
            if is_extension {
                let content = self.extension()?;
                if kind.is_gnu_longname() {
                    let end = content.iter().position(|&byte| byte == 0).unwrap_or(content.len());
                    long_name = Some(String::from_utf8_lossy(&content[..end]).into_owned());
                } else {
                    let records = pax_records(&content);
                    long_name = records.0.or(long_name);
                    long_size = records.1;
                }
            } else if kind.is_file() || kind.is_contiguous() {
                let short = || String::from_utf8_lossy(&header.path_bytes()).into_owned();
                return Ok(Some(long_name.unwrap_or_else(short)));
            } else if !(kind.is_dir() || kind.is_pax_global_extensions() || kind.is_gnu_longlink()) {
                let name = String::from_utf8_lossy(&header.path_bytes()).into_owned();
                return Err(Cause::value("the archive entry", name, "a regular file, no link or device"));
            }
        }
    }

    /// Reads the next header; `None` at the end of the archive.
    fn header(&mut self) -> Result<Option<Header>, Cause> {
        let mut block = Vec::new();
        (&mut self.source).take(BLOCK as u64).read_to_end(&mut block).map_err(Cause::read)?;
        if block.is_empty() || ends(&block) {
            return Ok(None);
        }
        if block.len() < BLOCK {
            let (found, expected) = (block.len() as u64, BLOCK as u64);
            return Err(Cause::Truncated { what: "the header of an archive entry", found, expected });
        }
        match header(&block) {
            Some(header) => Ok(Some(header)),
            None => Err(damaged("the checksum of a header does not match")),
        }
    }

    /// Reads the padding behind the last file. At the end of the stream, decompressors compare their
    /// checksums.
    fn end(&mut self) -> Result<(), Cause> {
        let padding = (&mut self.source).take(MAX_PADDING);
        let read = io::copy(&mut { padding }, &mut io::sink()).map_err(Cause::read)?;
        if read < MAX_PADDING { Ok(()) } else { Err(damaged("more than padding follows the last file")) }
    }

    fn extension(&mut self) -> Result<Vec<u8>, Cause> {
        if self.left > MAX_EXTENSION_LENGTH {
            return Err(Cause::value("the length of an extended header", self.left, "at most 64 KiB"));
        }
        let (mut content, expected) = (Vec::new(), self.left);
        let found = self.read_to_end(&mut content).map_err(Cause::read)? as u64;
        if found < expected {
            return Err(Cause::Truncated { what: "an extended header", found, expected });
        }
        Ok(content)
    }
}

impl Read for Archive {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = (&mut self.source).take(self.left).read(buffer)?;
        self.left -= read as u64;
        Ok(read)
    }
}

/// Returns the error of a damaged archive.
pub(super) fn damaged(what: &str) -> Cause {
    Cause::Undecodable(format!("{what}; fetch the archive again"))
}

/// Returns whether a block is the end of an archive: zeros.
pub(super) fn ends(block: &[u8]) -> bool {
    block.len() == BLOCK && block.iter().all(|&byte| byte == 0)
}

/// Returns whether a block is marked as a header but has no matching checksum.
pub(super) fn is_damaged(block: &[u8]) -> bool {
    block.get(MAGIC.0) == Some(MAGIC.1) && header(block).is_none()
}

/// Returns a header if its checksum matches.
pub(super) fn header(block: &[u8]) -> Option<Header> {
    let header = Header::from_byte_slice(block.get(..BLOCK)?);
    let bytes = block[..BLOCK].iter().enumerate();
    let sum: u32 =
        bytes.map(|(i, &byte)| if CHECKSUM.contains(&i) { u32::from(b' ') } else { u32::from(byte) }).sum();
    (header.cksum().ok()? == sum).then(|| header.clone())
}

/// Returns path and size from the records of an extended header, `LENGTH KEY=VALUE\n`.
fn pax_records(content: &[u8]) -> (Option<String>, Option<u64>) {
    let (mut path, mut size) = (None, None);
    for record in content.split(|&byte| byte == b'\n') {
        let record = String::from_utf8_lossy(record);
        let entry = record.split_once(' ').and_then(|(_, entry)| entry.split_once('='));
        match entry {
            Some(("path", value)) => path = Some(value.to_owned()),
            Some(("size", value)) => size = value.parse().ok(),
            _ => (),
        }
    }
    (path, size)
}
