//! Decompression of the pages of a row group in one context: the library makes a context for every column,
//! which takes longer than decompressing the pages of a few scenarios.

use std::io::Cursor;
use std::sync::Arc;

use bytes::Bytes;
use parking_lot::Mutex;
use parquet::arrow::arrow_reader::RowGroups;
use parquet::basic::Compression;
use parquet::column::page::{Page, PageIterator, PageMetadata, PageReader};
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::{ParquetMetaData, RowGroupMetaData};
use parquet::file::reader::ChunkReader;
use parquet::file::serialized_reader::SerializedPageReader;
use zstd::bulk::Decompressor;

/// A row group in memory.
pub(super) struct Group<R> {
    pub(super) data: Arc<R>,
    pub(super) metadata: Arc<ParquetMetaData>,
    pub(super) index: usize,
    /// For each column, the decompressed sizes of its pages in bytes; empty for columns that are not read.
    pub(super) sizes: Vec<Vec<usize>>,
    pub(super) zstd: Arc<Mutex<Decompressor<'static>>>,
}

impl<R> Group<R> {
    fn row_group(&self) -> &RowGroupMetaData {
        self.metadata.row_group(self.index)
    }
}

impl<R: ChunkReader + 'static> RowGroups for Group<R> {
    fn num_rows(&self) -> usize {
        self.row_group().num_rows() as usize
    }

    fn column_chunks(&self, i: usize) -> Result<Box<dyn PageIterator>> {
        let stored = self.row_group().column(i);
        let zstd = matches!(stored.compression(), Compression::ZSTD(_)).then(|| Arc::clone(&self.zstd));
        let column = match &zstd {
            // The library passes pages on as they are stored.
            Some(_) => stored.clone().into_builder().set_compression(Compression::UNCOMPRESSED).build()?,
            None => stored.clone(),
        };
        let pages = SerializedPageReader::new(Arc::clone(&self.data), &column, self.num_rows(), None)?;
        let sizes = self.sizes[i].clone().into_iter();
        Ok(Box::new(Chunk(Some(Box::new(Pages { pages, sizes, zstd })))))
    }

    fn row_groups(&self) -> Box<dyn Iterator<Item = &RowGroupMetaData> + '_> {
        Box::new(std::iter::once(self.row_group()))
    }

    fn metadata(&self) -> &ParquetMetaData {
        &self.metadata
    }
}

/// The only chunk of a column in a row group.
struct Chunk(Option<Box<dyn PageReader>>);

impl Iterator for Chunk {
    type Item = Result<Box<dyn PageReader>>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.take().map(Ok)
    }
}

impl PageIterator for Chunk {}

/// Pages of a column, in sequence.
struct Pages<R: ChunkReader> {
    pages: SerializedPageReader<R>,
    sizes: std::vec::IntoIter<usize>,
    /// Decompressor of pages that the library leaves compressed.
    zstd: Option<Arc<Mutex<Decompressor<'static>>>>,
}

impl<R: ChunkReader> PageReader for Pages<R> {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
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
