//! The footer of a Parquet file, whose row groups are decoded one at a time: the decoded metadata of all row
//! groups of many scenarios would need more memory than a run.

use std::io::SeekFrom;
use std::ops::Range;

use parquet::file::metadata::{
    ParquetMetaData, ParquetMetaDataOptions, ParquetMetaDataReader, RowGroupMetaData,
};

use super::compact::{CompactReader, LIST, STRUCTURE};
use super::reader::{Input, guarded};
use crate::error::Cause;

/// Maximum size of the footer in bytes.
const MAX_SIZE: u64 = 1 << 28;
/// Field of the row groups in the metadata of a file.
const ROW_GROUPS: i64 = 4;
/// Metadata of a file of version 1 without rows, whose schema is known, up to the list of its row groups.
const FILE: [u8; 5] = [0x15, 2, 0x26, 0, 0x19];
/// Begins a list of one structure.
const ONE_STRUCTURE: u8 = 1 << 4 | STRUCTURE;

/// The row groups of a footer, encoded.
pub(super) struct Footer {
    bytes: Vec<u8>,
    /// Place of each row group.
    groups: Vec<Range<usize>>,
    /// Has the schema.
    options: ParquetMetaDataOptions,
}

impl Footer {
    /// Reads the footer of a file. Also returns the metadata of the file, without row groups, and the number
    /// of bytes before the footer.
    pub(super) fn read(file: &mut dyn Input) -> Result<(Self, ParquetMetaData, u64), Cause> {
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
        let damaged = || Cause::Undecodable("the Parquet footer is damaged; fetch the file again".into());
        let (list, groups) = row_groups(&bytes).ok_or_else(damaged)?;
        // A file without the list is the library's to refuse.
        let none: &[u8] = if list.is_empty() { &[] } else { &[STRUCTURE] };
        let without_groups = [&bytes[..list.start], none, &bytes[list.end..]].concat();
        let metadata = decode(&without_groups, &ParquetMetaDataOptions::new())?;
        let schema = metadata.file_metadata().schema_descr_ptr();
        let options = ParquetMetaDataOptions::new().with_schema(schema);
        Ok((Self { bytes, groups, options }, metadata, length - 8 - size))
    }

    /// Returns the number of row groups.
    pub(super) fn groups(&self) -> usize {
        self.groups.len()
    }

    /// Decodes the metadata of a row group.
    pub(super) fn group(&self, index: usize) -> Result<RowGroupMetaData, Cause> {
        let group = &self.bytes[self.groups[index].clone()];
        let file = decode(&[&FILE, &[ONE_STRUCTURE][..], group, &[0]].concat(), &self.options)?;
        let mut groups = file.into_builder().take_row_groups();
        // The library ignores the types of fields, and may understand other data.
        let alone = groups.pop().filter(|_| groups.is_empty());
        alone.ok_or_else(|| Cause::Undecodable("the Parquet data are inconsistent".into()))
    }
}

/// Returns the places of the list of row groups and of each of them in a footer. The lengths of all lists are
/// checked: the library trusts those that it skips.
fn row_groups(bytes: &[u8]) -> Option<(Range<usize>, Vec<Range<usize>>)> {
    let mut reader = CompactReader::new(bytes);
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
    Some((list, groups))
}

fn decode(bytes: &[u8], options: &ParquetMetaDataOptions) -> Result<ParquetMetaData, Cause> {
    guarded(|| ParquetMetaDataReader::decode_metadata_with_options(bytes, Some(options)))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// Reads a footer and its row groups; returns their number.
    fn read(footer: &[u8]) -> Result<usize, String> {
        let size = (footer.len() as u32).to_le_bytes();
        let mut file = Cursor::new([b"PAR1", footer, &size, b"PAR1"].concat());
        let (footer, ..) = Footer::read(&mut file).map_err(|cause| cause.to_string())?;
        for index in 0..footer.groups() {
            footer.group(index).map_err(|cause| cause.to_string())?;
        }
        Ok(footer.groups())
    }

    #[test]
    fn malformed_footers_are_refused() {
        // Version, schema and number of rows, followed by other fields.
        let begun = [0x15, 2, 0x19, 0x1c, 0x48, 1, b'm', 0x15, 0, 0, 0x16, 0];
        let read = |rest: &[u8]| read(&[&begun, rest].concat());
        assert_eq!(read(&[0x19, 0x0c, 0]), Ok(0));
        let damaged = "the Parquet footer is damaged";
        for (what, rest, reason) in [
            ("no list", &[0][..], "row_groups"),
            ("another list", &[0x19, 0x0c, 0x09, 8, 0x0c, 0], damaged),
            ("a huge list", &[0x19, 0xfc, 0xff, 0xff, 0xff, 0xff, 15, 0], damaged),
            ("a list of numbers", &[0x19, 0x15, 2, 0], damaged),
            ("an empty row group", &[0x19, 0x1c, 0, 0], "required"),
        ] {
            let error = read(rest).unwrap_err();
            assert!(error.to_lowercase().contains(&reason.to_lowercase()), "{what}: {error}");
        }
    }

    #[test]
    fn footers_that_the_library_understands_otherwise_are_refused() {
        // The version has the type of a byte; the library reads two, and finds another list of row groups.
        let mut footer = vec![0x13, 0x80, 0x58, 0x19, 0x1c, 0x48, 1, b'm', 0x15, 0, 0, 0x16, 0, 0x19, 0x0c];
        footer.extend([0; 14]);
        footer.extend([0x09, 8, 0x1c, 0, 0]);
        assert!(read(&footer).is_err());
    }
}
