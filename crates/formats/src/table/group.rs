//! Decompression of the pages of a row group in one context: the library makes a context for every column,
//! which takes longer than decompressing the pages of a few scenarios.

use std::io::Cursor;
use std::sync::Arc;

use bytes::Bytes;
use parking_lot::Mutex;
use parquet::basic::{Compression, Encoding, Type};
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::ChunkReader;
use parquet::file::serialized_reader::SerializedPageReader;
use zstd::bulk::Decompressor;

/// A row group in memory.
pub(super) struct Group<'a, R> {
    pub(super) data: Arc<R>,
    pub(super) metadata: &'a RowGroupMetaData,
    /// For each column, the decompressed sizes of its pages in bytes; empty for columns that are not read.
    pub(super) sizes: Vec<Vec<usize>>,
    pub(super) zstd: Arc<Mutex<Decompressor<'static>>>,
}

impl<R: ChunkReader + 'static> Group<'_, R> {
    /// Returns the reader of the pages of a column.
    pub(super) fn pages(&self, column: usize) -> Result<Box<dyn PageReader>> {
        let stored = self.metadata.column(column);
        let zstd = matches!(stored.compression(), Compression::ZSTD(_)).then(|| Arc::clone(&self.zstd));
        let chunk = match &zstd {
            // The library passes pages on as they are stored.
            Some(_) => stored.clone().into_builder().set_compression(Compression::UNCOMPRESSED).build()?,
            None => stored.clone(),
        };
        let rows = self.metadata.num_rows() as usize;
        let pages = SerializedPageReader::new(Arc::clone(&self.data), &chunk, rows, None)?;
        let (sizes, descriptor) = (self.sizes[column].clone().into_iter(), stored.column_descr());
        let has_levels = [descriptor.max_rep_level() > 0, descriptor.max_def_level() > 0];
        let has_doubles = descriptor.physical_type() == Type::DOUBLE;
        Ok(Box::new(Pages { pages, sizes, zstd, has_levels, has_doubles }))
    }
}

/// Pages of a column, in sequence.
struct Pages<R: ChunkReader> {
    pages: SerializedPageReader<R>,
    sizes: std::vec::IntoIter<usize>,
    /// Decompressor of pages that the library leaves compressed.
    zstd: Option<Arc<Mutex<Decompressor<'static>>>>,
    /// Whether pages have repetition levels, and definition levels.
    has_levels: [bool; 2],
    has_doubles: bool,
}

impl<R: ChunkReader> Pages<R> {
    fn next_decompressed(&mut self) -> Result<Option<Page>> {
        let (mut page, size) = (self.pages.get_next_page()?, self.sizes.next().unwrap_or_default());
        let (Some(found), Some(zstd)) = (&mut page, &self.zstd) else { return Ok(page) };
        match found {
            Page::DataPageV2 { is_compressed: false, .. } => {}
            Page::DataPageV2 { buf, def_levels_byte_len, rep_levels_byte_len, .. } => {
                let plain = (*def_levels_byte_len + *rep_levels_byte_len) as usize;
                *buf = decompressed(&mut zstd.lock(), buf, plain, size)?;
            }
            Page::DataPage { buf, .. } | Page::DictionaryPage { buf, .. } => {
                *buf = decompressed(&mut zstd.lock(), buf, 0, size)?;
            }
        }
        Ok(page)
    }
}

impl<R: ChunkReader> PageReader for Pages<R> {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let mut page = self.next_decompressed()?;
        if let Some(page) = page.as_mut().filter(|_| self.has_doubles) {
            join(page, self.has_levels);
        }
        Ok(page)
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.sizes.next();
        self.pages.skip_next_page()
    }
}

impl<R: ChunkReader> Iterator for Pages<R> {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

/// Decompresses a page of `size` bytes, of which the first `plain` are not compressed.
fn decompressed(zstd: &mut Decompressor<'_>, page: &Bytes, plain: usize, size: usize) -> Result<Bytes> {
    let damaged = || ParquetError::General("a page has another size than its header states".into());
    let (levels, values) = page.split_at_checked(plain).filter(|_| plain <= size).ok_or_else(damaged)?;
    let mut whole = Vec::with_capacity(size);
    whole.extend_from_slice(levels);
    // A page without values is empty.
    if plain < size {
        let mut rest = Cursor::new(&mut whole);
        rest.set_position(plain as u64);
        zstd.decompress_to_buffer(values, &mut rest)?;
    }
    if whole.len() == size { Ok(whole.into()) } else { Err(damaged()) }
}

/// Joins the bytes of `double`s that a page stores apart, those of each place together, so that the page has
/// plain numbers: the library joins them byte by byte. Malformed pages are left to it.
fn join(page: &mut Page, has_levels: [bool; 2]) {
    let (buf, encoding, levels) = match page {
        Page::DataPage {
            buf,
            encoding,
            def_level_encoding: Encoding::RLE,
            rep_level_encoding: Encoding::RLE,
            ..
        } => {
            // Before the levels of each kind is their length.
            let mut levels = 0;
            for _ in has_levels.into_iter().filter(|has| *has) {
                let Some(length) = buf.get(levels..).and_then(<[u8]>::first_chunk) else { return };
                levels += 4 + u32::from_le_bytes(*length) as usize;
            }
            (buf, encoding, levels)
        }
        Page::DataPageV2 { buf, encoding, def_levels_byte_len, rep_levels_byte_len, .. } => {
            (buf, encoding, (*def_levels_byte_len + *rep_levels_byte_len) as usize)
        }
        _ => return,
    };
    let Some((levels, bytes)) = buf.split_at_checked(levels) else { return };
    if *encoding == Encoding::BYTE_STREAM_SPLIT && bytes.len().is_multiple_of(8) {
        let mut plain = Vec::with_capacity(buf.len());
        plain.extend_from_slice(levels);
        joined(bytes, &mut plain);
        (*buf, *encoding) = (plain.into(), Encoding::PLAIN);
    }
}

/// Appends numbers of eight bytes, of which first the first bytes are given, then the second bytes, and so
/// on.
fn joined(bytes: &[u8], numbers: &mut Vec<u8>) {
    let count = bytes.len() / 8;
    let places: [&[u8]; 8] = std::array::from_fn(|k| &bytes[k * count..][..count]);
    let blocks = places.map(|place| place.as_chunks::<8>());
    for i in 0..count / 8 {
        let mut rows = blocks.map(|(chunks, _)| u64::from_le_bytes(chunks[i]));
        transpose(&mut rows);
        numbers.extend_from_slice(rows.map(u64::to_le_bytes).as_flattened());
    }
    for i in count / 8 * 8..count {
        numbers.extend_from_slice(&places.map(|place| place[i]));
    }
}

/// Transposes a matrix of bytes: those of a number are a row, the lowest first.
fn transpose(rows: &mut [u64; 8]) {
    // Exchanges the halves of the matrix that are not on the diagonal, then those of its quarters, and so on.
    for (half, kept) in [(4, 0x0000_0000_ffff_ffff), (2, 0x0000_ffff_0000_ffff), (1, 0x00ff_00ff_00ff_00ff)] {
        for i in (0..8).filter(|i| i & half == 0) {
            let exchanged = ((rows[i] >> (8 * half)) ^ rows[i + half]) & kept;
            rows[i + half] ^= exchanged;
            rows[i] ^= exchanged << (8 * half);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::joined;

    #[test]
    fn numbers_are_joined_of_their_bytes() {
        for count in [0, 1, 7, 8, 9, 91] {
            let numbers: Vec<u64> =
                (1..=count).map(|n| u64::wrapping_mul(n, 0x9e37_79b9_7f4a_7c15)).collect();
            let place = |k: usize| numbers.iter().map(move |number| number.to_le_bytes()[k]);
            let (mut plain, apart) = (vec![7], (0..8).flat_map(place).collect::<Vec<u8>>());
            joined(&apart, &mut plain);
            assert_eq!(plain[0], 7);
            assert!(plain[1..].iter().copied().eq(numbers.iter().flat_map(|number| number.to_le_bytes())));
        }
    }
}
