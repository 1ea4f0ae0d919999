//! The footer of a Parquet file, of which the library decodes a few row groups at a time: the decoded metadata
//! of all row groups of many scenarios would need more memory than a run.

use std::io::SeekFrom;
use std::ops::Range;

use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader, RowGroupMetaData};

use super::compact::{CompactReader, LIST, STRUCTURE};
use super::reader::{Input, guarded};
use crate::error::Cause;

/// Maximum size of the footer in bytes.
const MAX_SIZE: u64 = 1 << 28;
/// Field of the row groups in the metadata of a file.
const ROW_GROUPS: i64 = 4;
/// Number of row groups that are decoded together, below 15: longer lists are encoded differently.
const TOGETHER: usize = 8;

/// An encoded footer.
pub(super) struct Footer {
    bytes: Vec<u8>,
    /// Place of the list of row groups.
    list: Range<usize>,
    /// Place of each row group.
    groups: Vec<Range<usize>>,
    /// Number of the first of the decoded row groups, and their metadata: that of a file that has them alone.
    decoded: Option<(usize, ParquetMetaData)>,
}

impl Footer {
    /// Reads the footer of a file. Also returns the number of bytes before it.
    pub(super) fn read(file: &mut dyn Input) -> Result<(Self, u64), Cause> {
        let length = file.seek(SeekFrom::End(0)).map_err(Cause::read)?;
        if length < 12 {
            return Err(Cause::Truncated { what: "the Parquet file", found: length, expected: 12 });
        }
        let mut tail = [0; 8];
        file.seek(SeekFrom::End(-8)).and_then(|_| file.read_exact(&mut tail)).map_err(Cause::read)?;
        let [a, b, c, d, magic @ ..] = tail;
        if &magic != b"PAR1" {
            let why = "it does not end with the Parquet mark `PAR1`; the file may be truncated";
            return Err(Cause::Undecodable(why.into()));
        }
        let size = u64::from(u32::from_le_bytes([a, b, c, d]));
        if size > MAX_SIZE || size + 12 > length {
            return Err(Cause::value("the length of the Parquet footer", size, "less than the file holds"));
        }
        let mut bytes = vec![0; size as usize];
        file.seek(SeekFrom::End(-8 - size as i64))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(Cause::read)?;
        let footer = Self::of(bytes);
        let footer = footer.ok_or_else(|| {
            Cause::Undecodable("the Parquet footer is damaged; fetch the file again".into())
        })?;
        Ok((footer, length - 8 - size))
    }

    /// Finds the row groups. The lengths of all lists are checked: the library trusts those that it skips.
    fn of(bytes: Vec<u8>) -> Option<Self> {
        let mut reader = CompactReader::new(&bytes);
        let place = |reader: &CompactReader<'_>| bytes.len() - reader.rest().len();
        let (mut last, mut list, mut groups) = (0, 0..0, Vec::new());
        while let Some((id, kind)) = reader.field(&mut last)? {
            if id != ROW_GROUPS || kind != LIST {
                reader.skip(kind)?;
                continue;
            }
            // There is one such field.
            if list.start > 0 {
                return None;
            }
            list.start = place(&reader);
            let (STRUCTURE, count) = reader.list()? else { return None };
            for _ in 0..count {
                let start = place(&reader);
                reader.skip(STRUCTURE)?;
                groups.push(start..place(&reader));
            }
            list.end = place(&reader);
        }
        Some(Self { list, groups, bytes, decoded: None })
    }

    /// Returns the number of row groups.
    pub(super) fn groups(&self) -> usize {
        self.groups.len()
    }

    /// Decodes the metadata of the file, without its row groups.
    pub(super) fn file(&self) -> Result<ParquetMetaData, Cause> {
        let (before, after) = (&self.bytes[..self.list.start], &self.bytes[self.list.end..]);
        // A file without this field is the library's to refuse.
        let list: &[u8] = if self.list.is_empty() { &[] } else { &[STRUCTURE] };
        decode(&[before, list, after].concat())
    }

    /// Returns the metadata of a row group, which are decoded with those of its neighbours.
    pub(super) fn group(&mut self, index: usize) -> Result<&RowGroupMetaData, Cause> {
        let first = index / TOGETHER * TOGETHER;
        let decoded = match self.decoded.take() {
            Some((known, decoded)) if known == first => decoded,
            _ => {
                let groups = &self.groups[first..self.groups.len().min(first + TOGETHER)];
                let list = [(groups.len() as u8) << 4 | STRUCTURE];
                let of_groups = &self.bytes[groups[0].start..groups[groups.len() - 1].end];
                decode(&[&self.bytes[..self.list.start], &list, of_groups, &[0]].concat())?
            }
        };
        let (_, decoded) = self.decoded.insert((first, decoded));
        Ok(decoded.row_group(index - first))
    }
}

fn decode(bytes: &[u8]) -> Result<ParquetMetaData, Cause> {
    guarded(|| ParquetMetaDataReader::decode_metadata(bytes))
}
