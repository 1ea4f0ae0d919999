//! Decompressed sizes of the pages of a Parquet file, from their headers, before the library decodes them.
//! The library trusts the sizes in the headers, so a file of some kilobytes could exhaust the memory.

use std::io::{Read, sink};

use flate2::read::MultiGzDecoder;
use parquet::basic::Compression;

use super::compact::CompactReader;
use crate::error::Cause;

/// Maximum size of a decompressed page in bytes; usual pages have a megabyte.
const MAX_PAGE_SIZE: u64 = 256 << 20;
/// Maximum number of values of a column in a row group; usual row groups have a million rows.
const MAX_VALUES: u64 = 1 << 27;
/// Maximum ratio of decompressed to compressed size for Deflate.
const DEFLATE_RATIO: u64 = 1032;
/// Maximum ratio of decompressed to compressed size for LZ4.
const LZ4_RATIO: u64 = 255;
/// Maximum size of a zstd block in bytes.
const ZSTD_BLOCK_SIZE: u64 = 128 << 10;
/// Size of a value in memory in bytes; in the file, null and repeated values may take no space.
const VALUE_SIZE: u64 = 8;
/// Number of `PageType::INDEX_PAGE` (parquet.thrift).
const INDEX_PAGE: i64 = 1;

/// Checks all pages of a column chunk and returns the memory they need in bytes, that of the longest page or
/// of all values, whichever is larger; and the size in bytes that each page states, without index pages.
pub(super) fn check(chunk: &[u8], column: &str, codec: Compression) -> Result<(u64, Vec<usize>), Cause> {
    let (mut rest, mut longest, mut values, mut sizes) = (chunk, 0, 0, Vec::new());
    let damaged = |what: &str| Cause::Undecodable(format!("{what} of column `{column}` is damaged"));
    while !rest.is_empty() {
        let mut reader = CompactReader::new(rest);
        let page = header(&mut reader).ok_or_else(|| damaged("the header of a Parquet page"))?;
        let parts = reader.rest().split_at_checked(page.compressed);
        let (content, after) = parts.ok_or_else(|| damaged("the length of a Parquet page"))?;
        rest = after;
        let plain = page.plain.min(content.len());
        let real = match &content[plain..] {
            data if page.is_compressed => expanded(data, codec).map_err(|error| match error {
                ExpansionError::Damaged => damaged("a compressed Parquet page"),
                ExpansionError::UnsupportedCodec => {
                    let expected = "none, SNAPPY, GZIP, ZSTD or LZ4: rewrite the file with one of them";
                    Cause::value(format!("the compression of column `{column}`"), codec, expected)
                }
            })?,
            _ => 0,
        };
        let length = page.stated.max(plain as u64 + real);
        if length > MAX_PAGE_SIZE {
            let most = format!("at most {} MiB", MAX_PAGE_SIZE >> 20);
            let what = format!("the length of a decompressed page of column `{column}`");
            return Err(Cause::value(what, format!("{length} bytes"), most));
        }
        (longest, values) = (longest.max(length), values + page.values);
        sizes.extend((page.kind != INDEX_PAGE).then_some(page.stated as usize));
        if values > MAX_VALUES {
            let most = format!("at most {MAX_VALUES}: write smaller row groups");
            let what = format!("the number of values of column `{column}` in a row group");
            return Err(Cause::value(what, values, most));
        }
    }
    Ok((longest.max(values * VALUE_SIZE), sizes))
}

struct PageHeader {
    kind: i64,
    /// Decompressed size in bytes.
    stated: u64,
    /// Size in the file in bytes.
    compressed: usize,
    /// Size of the part at the beginning that is never compressed, in bytes.
    plain: usize,
    values: u64,
    is_compressed: bool,
}

/// Reads a `PageHeader` (parquet.thrift); `None` if it is malformed.
fn header(reader: &mut CompactReader<'_>) -> Option<PageHeader> {
    let (mut kind, mut stated, mut compressed) = (None, None, None);
    let (mut values, mut plain, mut is_compressed) = (0_i64, 0_i64, true);
    let mut last = 0;
    while let Some((id, field_kind)) = reader.field(&mut last)? {
        match id {
            1 => kind = Some(reader.whole()?),
            2 => stated = Some(reader.whole()?),
            3 => compressed = Some(reader.whole()?),
            // The headers of data pages, dictionary pages and data pages of version 2.
            5 | 7 | 8 => {
                let mut inner = 0;
                while let Some((field, kind)) = reader.field(&mut inner)? {
                    match (id, field) {
                        (_, 1) => values = reader.whole()?,
                        (8, 5 | 6) => plain = plain.checked_add(reader.whole()?)?,
                        (8, 7) => is_compressed = CompactReader::flag(kind)?,
                        _ => reader.skip(kind)?,
                    }
                }
            }
            _ => reader.skip(field_kind)?,
        }
    }
    Some(PageHeader {
        kind: kind?,
        stated: u64::try_from(stated?).ok()?,
        compressed: usize::try_from(compressed?).ok()?,
        plain: usize::try_from(plain).ok()?,
        values: u64::try_from(values).ok()?,
        is_compressed,
    })
}

/// Reason why a page cannot be decompressed.
enum ExpansionError {
    Damaged,
    /// No decoder for the codec is compiled in.
    UnsupportedCodec,
}

/// Returns an upper bound of the decompressed size in bytes. If no cheap bound is low enough, decompresses
/// the data and returns the exact size.
fn expanded(data: &[u8], codec: Compression) -> Result<u64, ExpansionError> {
    let length = data.len() as u64;
    Ok(match codec {
        // The library allocates no more than the size stated in the header.
        Compression::UNCOMPRESSED | Compression::SNAPPY | Compression::LZ4_RAW => 0,
        Compression::LZ4 => length.saturating_mul(LZ4_RATIO),
        Compression::GZIP(_) if length.saturating_mul(DEFLATE_RATIO) <= MAX_PAGE_SIZE => {
            length * DEFLATE_RATIO
        }
        Compression::GZIP(_) => count(MultiGzDecoder::new(data))?,
        Compression::ZSTD(_) => match zstd_bound(data) {
            bound if bound <= MAX_PAGE_SIZE => bound,
            _ => count(zstd::Decoder::with_buffer(data).map_err(|_| ExpansionError::Damaged)?)?,
        },
        Compression::BROTLI(_) | Compression::LZO => return Err(ExpansionError::UnsupportedCodec),
    })
}

/// Counts the bytes of a reader, up to one more than the maximum page size.
fn count(bytes: impl Read) -> Result<u64, ExpansionError> {
    std::io::copy(&mut bytes.take(MAX_PAGE_SIZE + 1), &mut sink()).map_err(|_| ExpansionError::Damaged)
}

/// Returns an upper bound of the decompressed size of zstd frames (RFC 8878, section 3.1) from their blocks.
/// The content size stated by a frame is ignored, because it is not needed for the bound. Stops at data that
/// are not frames, as the library does.
fn zstd_bound(mut data: &[u8]) -> u64 {
    let mut bound = 0_u64;
    let word = |data: &[u8]| data.first_chunk::<4>().map(|bytes| u32::from_le_bytes(*bytes));
    while let Some(magic) = word(data) {
        data = &data[4..];
        if magic & 0xffff_fff0 == 0x184d_2a50 {
            // A skippable frame.
            let Some(length) = word(data) else { break };
            data = data.get(4 + length as usize..).unwrap_or_default();
            continue;
        }
        let (0xfd2f_b528, Some(&descriptor)) = (magic, data.first()) else { break };
        let single = descriptor & 0x20 != 0;
        let size = match descriptor >> 6 {
            0 => usize::from(single),
            n => 1 << n,
        };
        let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
        data = data.get(1 + usize::from(!single) + dictionary + size..).unwrap_or_default();
        while let Some(head) = data.first_chunk::<3>() {
            let head = u32::from_le_bytes([head[0], head[1], head[2], 0]);
            let (is_last, kind, size) = (head & 1 == 1, head >> 1 & 3, head >> 3);
            // An RLE block is one byte in the file and `size` bytes when decompressed.
            let (stored, real) = match kind {
                0 => (size, u64::from(size)),
                1 => (1, u64::from(size)),
                _ => (size, ZSTD_BLOCK_SIZE),
            };
            bound += real;
            data = data.get(3 + stored as usize..).unwrap_or_default();
            if is_last {
                break;
            }
        }
        if descriptor & 4 != 0 {
            data = data.get(4..).unwrap_or_default();
        }
    }
    bound
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::sync::Arc;

    use arrow_array::{Int64Array, RecordBatch};
    use flate2::write::GzEncoder;
    use parquet::arrow::ArrowWriter;
    use parquet::file::properties::{EnabledStatistics, WriterProperties};
    use parquet::file::reader::{FileReader, SerializedFileReader};

    use super::*;
    use crate::table::TableReader;

    const ZSTD: fn() -> Compression = || "ZSTD(1)".parse().unwrap();
    const GZIP: fn() -> Compression = || "GZIP(6)".parse().unwrap();

    /// Encodes a page with this content.
    fn page(stated: i32, values: i32, content: &[u8]) -> Vec<u8> {
        let zigzag = |mut page: Vec<u8>, number: usize| {
            let mut rest = 2 * number;
            while rest > 127 {
                page.push(rest as u8 | 128);
                rest >>= 7;
            }
            page.push(rest as u8);
            page
        };
        let mut page = zigzag(vec![0x15, 0, 0x15], stated as usize);
        page.push(0x15);
        page = zigzag(page, content.len());
        page.extend([0x2c, 0x15]);
        page = zigzag(page, values as usize);
        page.extend([0, 0]);
        page.extend(content);
        page
    }

    fn error(chunk: &[u8], codec: Compression) -> String {
        check(chunk, "heading", codec).unwrap_err().to_string()
    }

    fn gzip(bytes: usize) -> Vec<u8> {
        let mut out = GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::copy(&mut std::io::repeat(0).take(bytes as u64), &mut out).unwrap();
        out.finish().unwrap()
    }

    /// Returns a zstd frame of RLE blocks only.
    fn runs(blocks: usize) -> Vec<u8> {
        let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x58];
        for block in 0..blocks {
            let head = (ZSTD_BLOCK_SIZE as u32) << 3 | 1 << 1 | u32::from(block + 1 == blocks);
            frame.extend(&head.to_le_bytes()[..3]);
            frame.push(7);
        }
        frame
    }

    #[test]
    fn valid_pages_pass() {
        let two = [page(1000, 10, &[0; 30]), page(50, 10, &[0; 20])].concat();
        assert_eq!(check(&two, "x", Compression::SNAPPY).unwrap().0, 1000);
        assert!(check(&page(90_000, 10, &gzip(90_000)), "x", GZIP()).unwrap().0 >= 90_000);
        assert_eq!(check(&page(9, 10, &runs(20)), "x", ZSTD()).unwrap().0, 20 * ZSTD_BLOCK_SIZE);
        assert_eq!(
            zstd::decode_all(&runs(20)[..]).unwrap().len() as u64,
            20 * ZSTD_BLOCK_SIZE,
            "a valid frame"
        );
        // Above the limit by ratio, but the exact size is counted.
        let noise: Vec<u8> = (0..400_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        let mut out = GzEncoder::new(Vec::new(), flate2::Compression::none());
        out.write_all(&noise).unwrap();
        let page = page(400_000, 10, &out.finish().unwrap());
        assert_eq!(check(&page, "x", GZIP()).unwrap().0, 400_000);
    }

    #[test]
    fn decompression_bombs_are_refused() {
        let most = "the length of a decompressed page of column `heading` is";
        assert!(error(&page(i32::MAX, 10, &[0; 9]), Compression::SNAPPY).starts_with(most));
        assert!(error(&page(100, 10, &gzip(300 << 20)), GZIP()).starts_with(most));
        assert!(error(&page(100, 10, &runs(3000)), ZSTD()).starts_with(most));
        // The second page, and the second frame of a page.
        let second = [page(9, 9, &[1]), page(i32::MAX, 9, &[])].concat();
        assert!(error(&second, Compression::UNCOMPRESSED).starts_with(most));
        let skippable = [0x50, 0x2a, 0x4d, 0x18, 2, 0, 0, 0, 9, 9];
        assert!(
            error(&page(9, 9, &[runs(1), skippable.into(), runs(3000)].concat()), ZSTD()).starts_with(most)
        );
        let values = error(&page(9, i32::MAX, &[]), Compression::UNCOMPRESSED);
        assert!(values.starts_with("the number of values of column `heading`"), "{values}");
        let codec = error(&page(9, 9, &[0; 4]), "BROTLI(1)".parse().unwrap());
        assert!(codec.contains("compression of column `heading` is BROTLI"), "{codec}");
    }

    #[test]
    fn values_without_bytes_are_counted() {
        assert_eq!(check(&page(9, 1 << 26, &[]), "x", Compression::UNCOMPRESSED).unwrap().0, 1 << 29);
    }

    #[test]
    fn damage_is_reported() {
        let whole = page(100, 10, &[0; 40]);
        for cut in 1..whole.len() {
            assert!(error(&whole[..cut], Compression::SNAPPY).contains("column `heading` is damaged"));
        }
        assert!(error(&[0; 8], Compression::SNAPPY).contains("header of a Parquet page"));
    }

    #[test]
    fn the_bound_holds_for_what_the_library_writes() {
        for length in [0, 1, 1000, 200_000, 1_000_000] {
            let patterns: [fn(usize) -> u8; 3] =
                [|_| 0, |i| (i.wrapping_mul(2_654_435_761) >> 11) as u8, |i| (i / 7 % 50) as u8];
            for pattern in patterns {
                let plain: Vec<u8> = (0..length).map(pattern).collect();
                let packed = zstd::encode_all(&plain[..], 3).unwrap();
                let bound = zstd_bound(&packed);
                assert!(
                    bound >= length as u64 && bound <= 2 * length as u64 + ZSTD_BLOCK_SIZE,
                    "{length}: {bound}"
                );
                let twice = zstd_bound(&[packed.clone(), packed].concat());
                assert_eq!(twice, 2 * bound);
            }
        }
    }

    #[test]
    fn a_table_is_checked_before_it_is_decoded() {
        let properties = WriterProperties::builder()
            .set_compression(ZSTD())
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::None)
            .build();
        let numbers: Vec<i64> =
            (0..400_i64).map(|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15_u64 as i64)).collect();
        let batch = RecordBatch::try_from_iter([("n", Arc::new(Int64Array::from(numbers)) as _)]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.parquet");
        let mut writer =
            ArrowWriter::try_new(std::fs::File::create(&path).unwrap(), batch.schema(), Some(properties))
                .unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
        let read =
            |path| TableReader::open(path).unwrap().next_batch().unwrap().map(|batch| batch.num_rows());
        assert_eq!(read(&path).unwrap(), 64);

        let reader = SerializedFileReader::new(std::fs::File::open(&path).unwrap()).unwrap();
        let (start, length) = reader.metadata().row_group(0).column(0).byte_range();
        let bare = page(i32::MAX, 400, &[]).len();
        let forged = page(i32::MAX, 400, &vec![0; length as usize - bare - 1]);
        assert_eq!(forged.len() as u64, length, "as long as the original");
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[start as usize..][..forged.len()].copy_from_slice(&forged);
        std::fs::write(&path, bytes).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("a decompressed page of column `n`"), "{error}");
    }
}
