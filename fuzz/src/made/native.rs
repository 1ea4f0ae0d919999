use arrow_array::RecordBatch;
use bytes::Bytes;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::arrow::arrow_writer::ArrowWriterOptions;
use parquet::basic::Compression;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};

use crate::formats::{native, parse_json};

/// Key of the checksums of native files.
const SUMS: &str = "reactsim.row_groups";

/// A table without compression, so that changed bytes are changed values.
pub(super) fn table(batch: &RecordBatch, said: Option<Vec<KeyValue>>) -> Vec<u8> {
    let properties = WriterProperties::builder()
        .set_compression(Compression::UNCOMPRESSED)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_offset_index_disabled(true)
        .set_key_value_metadata(said)
        .build();
    let options = ArrowWriterOptions::new().with_properties(properties).with_skip_arrow_metadata(true);
    let mut out = Vec::new();
    let mut writer = ArrowWriter::try_new_with_options(&mut out, batch.schema(), options).expect("a writer");
    writer.write(batch).expect("rows");
    writer.close().expect("a table");
    out
}

/// A hand-written scenario as a native file: as this program writes it, and without compression.
pub fn with_whole_pages(json: &[u8]) -> [Vec<u8>; 2] {
    let scenario = parse_json("seed.json".as_ref(), json).expect("a good scenario");
    let path = crate::folder().join("seed.parquet");
    let mut writer = native::Writer::create(&path).expect("a file");
    writer.write(&scenario).expect("a scenario");
    writer.finish().expect("a file");
    let written = std::fs::read(&path).expect("what was written");
    let reader = ParquetRecordBatchReaderBuilder::try_new(Bytes::from(written.clone())).expect("a table");
    let said = reader.metadata().file_metadata().key_value_metadata().cloned().expect("metadata");
    let mut batches = reader.build().expect("a table");
    let batch = batches.next().expect("a row").expect("a row");
    // Row groups begin behind the first four bytes; the sum is repaired once it is known where they end.
    let said = |end: usize| {
        let of = |pair: KeyValue| match pair.key == SUMS {
            true => KeyValue::new(SUMS.to_owned(), format!("4:{end}:1:00000000")),
            false => pair,
        };
        Some(said.iter().cloned().map(of).collect())
    };
    let end = |file: &[u8]| {
        let at = file.len() - 8;
        at - u32::from_le_bytes(file[at..at + 4].try_into().expect("four bytes")) as usize
    };
    let plain = table(&batch, said(end(&table(&batch, said(0)))));
    [written, repaired(&plain)]
}

/// The file with checksums of row groups that hold, wherever some are stated.
pub fn repaired(file: &[u8]) -> Vec<u8> {
    let mut file = file.to_vec();
    let Some(key) = file.windows(SUMS.len()).rposition(|w| w == SUMS.as_bytes()) else { return file };
    // The value follows its own header of two or three bytes: numbers, colons and commas.
    let mut at = key + SUMS.len();
    let is_sum = |b: u8| b.is_ascii_hexdigit() || b == b':' || b == b',';
    at += file[at..].iter().take(4).position(|b| b.is_ascii_digit()).unwrap_or(4);
    let length = file.get(at..).unwrap_or_default().iter().take_while(|b| is_sum(**b)).count();
    let text = String::from_utf8_lossy(file.get(at..at + length).unwrap_or_default()).into_owned();
    for group in text.split(',') {
        let parts: Vec<&str> = group.split(':').collect();
        if let [start, end, _, sum] = parts[..]
            && sum.len() == 8
            && let (Ok(start), Ok(end)) = (start.parse::<usize>(), end.parse::<usize>())
            && let Some(data) = file.get(start..end)
        {
            let right = format!("{:08x}", crc32c::crc32c(data));
            let place = at + group.len() - 8;
            file[place..place + 8].copy_from_slice(right.as_bytes());
        }
        at += group.len() + 1;
    }
    file
}
