//! Reading of Parquet by row group. Every number of the footer is checked before it is used.

use std::borrow::Cow;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use parking_lot::Mutex;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{ArrowReaderMetadata, ArrowReaderOptions};
use parquet::errors::ParquetError;
use parquet::file::metadata::{ParquetMetaData, RowGroupMetaData};
use parquet::file::reader::{ChunkReader, Length};
use reactsim_files::open_regular;
use zstd::bulk::Decompressor;

use super::batch::{Batch, Decoder};
use super::footer::Footer;
use super::group::Group;
use super::{GROUP_CHECKSUMS, KIND, MAX_GROUP_ROWS, METADATA_CHECKSUM, VERSION, pages};
use crate::error::{Cause, FormatError};

/// Number of rows that are decoded at a time.
const BATCH_SIZE: usize = 64;
/// Maximum memory in bytes for the decompressed pages of a row group, summed over its columns.
const MAX_GROUP_MEMORY: u64 = 1 << 30;

/// Reader of the row groups of a Parquet file.
pub struct TableReader {
    path: PathBuf,
    file: Box<dyn Input>,
    /// Of the file, without row groups.
    metadata: ArrowReaderMetadata,
    footer: Footer,
    groups: Vec<RowGroup>,
    /// Index of the next row group.
    next: usize,
    /// Columns that are decoded; empty for all.
    columns: Vec<&'static str>,
    decoder: Option<Decoder>,
    /// Number of rows left in the current row group.
    rows: usize,
}

/// Source that a Parquet file can be read from.
pub(super) trait Input: Read + Seek + Send {}

impl<T: Read + Seek + Send> Input for T {}

/// Byte range, number of rows and checksum of a row group.
struct RowGroup {
    start: u64,
    end: u64,
    rows: usize,
    checksum: Option<u32>,
}

impl TableReader {
    /// Opens a file and checks its footer.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let file = open_regular(path).map_err(|e| FormatError::file(path, Cause::read(e)))?;
        Self::over(path, Box::new(file))
    }

    /// Like [`TableReader::open`], for content in memory; errors refer to it as `name`.
    pub fn of_bytes(name: &Path, content: impl Into<Cow<'static, [u8]>>) -> Result<Self, FormatError> {
        Self::over(name, Box::new(Cursor::new(content.into())))
    }

    pub(super) fn over(path: &Path, mut file: Box<dyn Input>) -> Result<Self, FormatError> {
        let refuse = |cause| FormatError::file(path, cause);
        let (footer, metadata, length) = Footer::read(&mut *file).map_err(refuse)?;
        let groups = groups(&footer, &metadata, length).map_err(refuse)?;
        let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
        let metadata =
            guarded(|| ArrowReaderMetadata::try_new(Arc::new(metadata), options)).map_err(refuse)?;
        let path = path.to_owned();
        Ok(Self {
            path,
            file,
            metadata,
            footer,
            groups,
            next: 0,
            columns: Vec::new(),
            decoder: None,
            rows: 0,
        })
    }

    /// Returns a value of the file's metadata.
    pub fn key(&self, key: &str) -> Option<&str> {
        find(self.metadata.metadata(), key)
    }

    /// Refuses files of another kind or version, and files that this program did not write.
    pub fn require(&self, kind: &str, version: u32) -> Result<(), FormatError> {
        let version = version.to_string();
        for (key, expected) in [(KIND, kind), (VERSION, version.as_str())] {
            match self.key(key) {
                Some(found) if found == expected => {}
                found => {
                    let found = found.map_or("missing".to_owned(), |f| format!("`{f}`"));
                    let cause = Cause::schema(
                        format!("`{key}` in the file's metadata"),
                        found,
                        format!("`{expected}`"),
                    );
                    return Err(FormatError::file(&self.path, cause));
                }
            }
        }
        if self.key(GROUP_CHECKSUMS).is_none() {
            let cause =
                Cause::schema(format!("`{GROUP_CHECKSUMS}` in the file's metadata"), "missing", "present");
            return Err(FormatError::file(&self.path, cause));
        }
        self.check_metadata().map_err(|cause| FormatError::file(&self.path, cause))
    }

    /// Checks that the metadata match their checksum.
    fn check_metadata(&self) -> Result<(), Cause> {
        let Some(stated) = self.key(METADATA_CHECKSUM) else { return Ok(()) };
        let keys = stated.split(' ').skip(1).map(|key| (key, self.key(key).unwrap_or_default()));
        let found = super::metadata_checksum(keys);
        if found == stated {
            return Ok(());
        }
        let what = "the file's metadata";
        Err(Cause::Checksum { what, found, expected: stated.to_owned() })
    }

    /// Like [`TableReader::require`], but accepts files of other programs, which have no kind and version.
    pub(crate) fn expect(&self, kind: &str, version: u32) -> Result<(), FormatError> {
        if self.key(KIND).is_none() { Ok(()) } else { self.require(kind, version) }
    }

    pub(crate) fn has(&self, column: &str) -> bool {
        let fields = self.metadata.parquet_schema().root_schema().get_fields();
        fields.iter().any(|field| field.name() == column)
    }

    /// Restricts decoding to these columns; missing ones are ignored.
    pub(crate) fn only(&mut self, columns: impl IntoIterator<Item = &'static str>) {
        self.columns = columns.into_iter().collect();
    }

    /// Returns the next rows; `None` at the end and after an error.
    pub fn next_batch(&mut self) -> Option<Result<Batch, FormatError>> {
        match self.advance() {
            Ok(Some(batch)) => Some(Ok(batch)),
            Ok(None) => None,
            Err(cause) => {
                self.end();
                Some(Err(FormatError::file(&self.path, cause)))
            }
        }
    }

    /// Returns the number of row groups.
    pub fn groups(&self) -> usize {
        self.groups.len()
    }

    /// Passes over whole row groups, of at most `rows` rows together, and returns how many rows they have.
    pub(crate) fn pass_over(&mut self, rows: usize) -> usize {
        let mut passed = 0;
        while let Some(group) = self.groups.get(self.next).filter(|group| passed + group.rows <= rows) {
            passed += group.rows;
            self.next += 1;
        }
        passed
    }

    pub(crate) fn rows(&self) -> usize {
        self.groups.iter().map(|group| group.rows).sum()
    }

    /// Reads one row group with these columns, or all if `columns` is empty. Missing columns are left out.
    pub fn group(&mut self, index: usize, columns: &[&str]) -> Result<Batch, FormatError> {
        self.load_group(index, columns).map_err(|cause| FormatError::file(&self.path, cause))
    }

    fn load_group(&mut self, index: usize, columns: &[&str]) -> Result<Batch, Cause> {
        let group = &self.groups[index];
        if group.rows > MAX_GROUP_ROWS {
            let most = format!("at most {MAX_GROUP_ROWS}");
            return Err(Cause::value("the number of rows of a row group", group.rows, most));
        }
        let data = load(&mut *self.file, group)?;
        let mut decoder = data.decode(&self.metadata, &self.footer.group(index)?, columns)?;
        guarded(|| decoder.read(group.rows))
    }

    /// Stops reading.
    pub(crate) fn end(&mut self) {
        self.next = self.groups.len();
        self.decoder = None;
        self.rows = 0;
    }

    fn advance(&mut self) -> Result<Option<Batch>, Cause> {
        loop {
            let rows = self.rows.min(BATCH_SIZE);
            if let Some(decoder) = self.decoder.as_mut().filter(|_| rows > 0) {
                self.rows -= rows;
                return guarded(|| decoder.read(rows)).map(Some);
            }
            self.decoder = None;
            let Some(group) = self.groups.get(self.next) else { return Ok(None) };
            let data = load(&mut *self.file, group)?;
            let decoded = self.footer.group(self.next)?;
            self.decoder = Some(data.decode(&self.metadata, &decoded, &self.columns)?);
            self.rows = group.rows;
            self.next += 1;
        }
    }
}

/// Returns the leaves of these columns, or all if `columns` is empty.
fn mask(metadata: &ArrowReaderMetadata, columns: &[&str]) -> ProjectionMask {
    if columns.is_empty() {
        return ProjectionMask::all();
    }
    ProjectionMask::columns(metadata.parquet_schema(), columns.iter().copied())
}

/// Returns the kind of a Parquet file from its metadata: `Ok(None)` if there is none, `Err` if the footer
/// cannot be read.
pub fn kind(path: &Path) -> Result<Option<String>, Cause> {
    let (_, metadata, _) = Footer::read(&mut open_regular(path).map_err(Cause::read)?)?;
    Ok(find(&metadata, KIND).map(str::to_owned))
}

fn find<'a>(metadata: &'a ParquetMetaData, key: &str) -> Option<&'a str> {
    let pairs = metadata.file_metadata().key_value_metadata()?;
    pairs.iter().find(|p| p.key == key)?.value.as_deref()
}

/// Calls the Parquet library and turns panics into errors: the library does not check all of its input.
pub(super) fn guarded<T>(run: impl FnOnce() -> Result<T, ParquetError>) -> Result<T, Cause> {
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(Cause::Undecodable(error.to_string())),
        Err(_) => Err(Cause::Undecodable("the Parquet data are inconsistent".into())),
    }
}

/// Returns the row groups; every number is checked against the length of the data.
fn groups(footer: &Footer, metadata: &ParquetMetaData, length: u64) -> Result<Vec<RowGroup>, Cause> {
    let wrong = |what: &str| Cause::Undecodable(format!("the footer is inconsistent: {what}"));
    let mut groups = Vec::with_capacity(footer.groups());
    let mut total = 0i64;
    for index in 0..footer.groups() {
        let group = footer.group(index)?;
        let (mut first, mut last) = (u64::MAX, 0);
        for column in group.columns() {
            if column.file_path().is_some() {
                return Err(wrong("a column is in another file"));
            }
            let begin = column.dictionary_page_offset().unwrap_or(i64::MAX).min(column.data_page_offset());
            let (Ok(begin), Ok(size)) = (u64::try_from(begin), u64::try_from(column.compressed_size()))
            else {
                return Err(wrong("a column has a negative position"));
            };
            if column.num_values() < 0 || column.data_page_offset() < 0 {
                return Err(wrong("a column has a negative number of values"));
            }
            let end = begin.checked_add(size).filter(|end| *end <= length);
            let end = end.ok_or_else(|| wrong("a column ends after the data"))?;
            (first, last) = (first.min(begin), last.max(end));
        }
        let rows = usize::try_from(group.num_rows()).map_err(|_| wrong("a negative number of rows"))?;
        total = total.checked_add(group.num_rows()).ok_or_else(|| wrong("too many rows"))?;
        groups.push(RowGroup { start: first.min(last), end: last, rows, checksum: None });
    }
    if metadata.file_metadata().num_rows() != total {
        return Err(wrong("the row groups do not have the stated number of rows"));
    }
    let Some(sums) = find(metadata, GROUP_CHECKSUMS) else { return Ok(groups) };
    let mut stated = sums.split(',').filter(|s| !s.is_empty());
    for group in &mut groups {
        let sum = stated.next().ok_or_else(|| wrong("fewer checksums than row groups"))?;
        let parts: Vec<&str> = sum.split(':').collect();
        let [start, end, rows, sum] = parts[..] else { return Err(wrong("a checksum is malformed")) };
        let (Ok(start), Ok(end), Ok(rows), Ok(sum)) =
            (start.parse::<u64>(), end.parse::<u64>(), rows.parse::<usize>(), u32::from_str_radix(sum, 16))
        else {
            return Err(wrong("a checksum is malformed"));
        };
        if rows != group.rows || start > group.start || end < group.end || end > length {
            return Err(wrong(
                "checksums and row groups differ; if another program rewrote the file, use the original, or \
                 remove the metadata that begin with `reactsim.`",
            ));
        }
        (group.start, group.end, group.checksum) = (start, end, Some(sum));
    }
    if stated.next().is_some() { Err(wrong("more checksums than row groups")) } else { Ok(groups) }
}

fn load(file: &mut dyn Input, group: &RowGroup) -> Result<RowGroupData, Cause> {
    let expected = group.end - group.start;
    let mut data = Vec::with_capacity(expected as usize);
    file.seek(SeekFrom::Start(group.start)).map_err(Cause::read)?;
    Read::take(file, expected).read_to_end(&mut data).map_err(Cause::read)?;
    let found = data.len() as u64;
    if found < expected {
        return Err(Cause::Truncated { what: "a row group", found, expected });
    }
    if let Some(sum) = group.checksum {
        let read = crc32c::crc32c(&data);
        if read != sum {
            let (found, expected) = (format!("{read:08x}"), format!("{sum:08x}"));
            return Err(Cause::Checksum { what: "a row group", found, expected });
        }
    }
    Ok(RowGroupData { start: group.start, data: data.into() })
}

/// Bytes of one row group, addressed by their offset in the file.
struct RowGroupData {
    start: u64,
    data: Bytes,
}

impl RowGroupData {
    /// Begins to decode these columns, or all if `columns` is empty, of a row group with these metadata.
    fn decode(
        self,
        metadata: &ArrowReaderMetadata,
        group: &RowGroupMetaData,
        columns: &[&str],
    ) -> Result<Decoder, Cause> {
        let mask = mask(metadata, columns);
        let sizes = self.check(group, &mask)?;
        guarded(|| {
            let zstd = Arc::new(Mutex::new(Decompressor::new()?));
            Decoder::new(metadata, &mask, &Group { data: Arc::new(self), metadata: group, sizes, zstd })
        })
    }

    /// Checks that the pages of these columns can be decompressed within bounds, and returns the sizes that
    /// the pages of each column state, in bytes.
    fn check(&self, group: &RowGroupMetaData, mask: &ProjectionMask) -> Result<Vec<Vec<usize>>, Cause> {
        let (mut total, mut sizes) = (0_u64, Vec::new());
        for (leaf, column) in group.columns().iter().enumerate() {
            if !mask.leaf_included(leaf) {
                sizes.push(Vec::new());
                continue;
            }
            let (start, length) = column.byte_range();
            let chunk = self.slice(start, length as usize).map_err(|e| Cause::Undecodable(e.to_string()))?;
            let (memory, pages) = pages::check(&chunk, &column.column_path().string(), column.compression())?;
            total += memory;
            sizes.push(pages);
            if total > MAX_GROUP_MEMORY {
                let (found, most) = (
                    format!("more than {} MiB", MAX_GROUP_MEMORY >> 20),
                    "smaller row groups: rewrite the file",
                );
                return Err(Cause::value("the decompressed pages of a row group", found, most));
            }
        }
        Ok(sizes)
    }

    fn slice(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        let begin = start.checked_sub(self.start).and_then(|b| usize::try_from(b).ok());
        let range = begin.and_then(|b| Some(b..b.checked_add(length)?));
        match range {
            Some(range) if range.end <= self.data.len() => Ok(self.data.slice(range)),
            _ => Err(ParquetError::EOF("a page is outside its row group".into())),
        }
    }
}

impl Length for RowGroupData {
    fn len(&self) -> u64 {
        self.start + self.data.len() as u64
    }
}

impl ChunkReader for RowGroupData {
    type T = Cursor<Bytes>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        let rest = Length::len(self).saturating_sub(start);
        Ok(Cursor::new(self.slice(start, rest as usize)?))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        self.slice(start, length)
    }
}
