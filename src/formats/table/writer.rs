//! Writing Parquet so that no half file is left.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_writer::ArrowWriterOptions;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;

use super::columns::{Column, Leaf};
use super::{KIND, SAID, SUMS, VERSION};
use crate::formats::error::{Cause, FormatError};

/// A Parquet file being written. It gets its name when it is finished; dropped before, it is removed.
pub(crate) struct TableWriter {
    path: PathBuf,
    partial: PathBuf,
    columns: Vec<Column>,
    schema: Arc<Schema>,
    writer: Option<ArrowWriter<Summed>>,
    sums: Vec<String>,
    group: usize,
    /// Rows that are not written yet.
    waiting: usize,
    /// What the metadata say besides kind and version.
    said: Vec<(&'static str, String)>,
}

impl TableWriter {
    /// Begins a file of a kind and version, in row groups of `group` rows.
    pub(crate) fn create(
        path: &Path,
        (kind, version): (&str, u32),
        group: usize,
        columns: Vec<Column>,
    ) -> Result<Self, FormatError> {
        let refuse = |e| FormatError::file(path, Cause::Io { doing: "create", source: e });
        let name = path.file_name().ok_or_else(|| refuse(io::Error::from(io::ErrorKind::InvalidFilename)))?;
        if path.is_dir() {
            return Err(refuse(io::Error::from(io::ErrorKind::IsADirectory)));
        }
        if path.exists() && !path.is_file() {
            return Err(refuse(io::Error::other("is no regular file, and its place would be taken")));
        }
        let partial = path.with_file_name(format!(".{}.{}.partial", name.display(), std::process::id()));
        let file = File::create(&partial).map_err(refuse)?;
        let schema = Arc::new(Schema::new(columns.iter().map(Column::field).collect::<Vec<_>>()));
        let key = |k: &str, v: String| KeyValue::new(k.to_owned(), v);
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_statistics_enabled(EnabledStatistics::None)
            .set_offset_index_disabled(true)
            .set_dictionary_enabled(false)
            .set_created_by(format!("reactsim {}", env!("CARGO_PKG_VERSION")))
            .set_key_value_metadata(Some(vec![
                key(KIND, kind.to_owned()),
                key(VERSION, version.to_string()),
            ]));
        for column in &columns {
            let path = ColumnPath::from(column.path().split('.').map(str::to_owned).collect::<Vec<_>>());
            properties = match column.leaf() {
                // Coordinates share their high bytes: split by byte they shrink by a third.
                Leaf::Number => properties.set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT),
                Leaf::Text => properties.set_column_dictionary_enabled(path, true),
                Leaf::Whole | Leaf::Flag => properties,
            };
        }
        let sink = Summed { file: BufWriter::new(file), written: 0, sum: 0, start: 0 };
        let options =
            ArrowWriterOptions::new().with_properties(properties.build()).with_skip_arrow_metadata(true);
        let writer = ArrowWriter::try_new_with_options(sink, schema.clone(), options)
            .map_err(|e| FormatError::file(path, cause(e)))?;
        Ok(Self {
            path: path.to_owned(),
            partial,
            columns,
            schema,
            writer: Some(writer),
            sums: Vec::new(),
            group,
            waiting: 0,
            said: Vec::new(),
        })
    }

    /// The column of this name, to be filled.
    ///
    /// # Panics
    /// When the file has no such column: the schema is the program's own.
    pub(crate) fn column(&mut self, name: &str) -> &mut Column {
        self.columns.iter_mut().find(|c| c.name() == name).expect("columns are named as in the schema")
    }

    /// Says something in the file's metadata; a checksum over all that is said this way stands beside it.
    pub(crate) fn say(&mut self, key: &'static str, value: String) {
        self.said.push((key, value));
    }

    /// Ends a row, of which every column has been given its part.
    pub(crate) fn end_row(&mut self) -> Result<(), FormatError> {
        self.waiting += 1;
        if self.waiting < self.group { Ok(()) } else { self.flush() }
    }

    /// Writes what the columns hold as one row group.
    pub(crate) fn flush(&mut self) -> Result<(), FormatError> {
        self.waiting = 0;
        let arrays = self.columns.iter_mut().map(Column::take).collect();
        let refuse = |e| FormatError::file(&self.path, cause(e));
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let batch = RecordBatch::try_new(self.schema.clone(), arrays).map_err(|e| refuse(e.into()))?;
        if batch.num_rows() == 0 {
            return Ok(());
        }
        writer.write(&batch).map_err(refuse)?;
        writer.flush().map_err(refuse)?;
        // What Parquet's own buffer holds back belongs to this row group's sum.
        writer.sync().map_err(|e| refuse(e.into()))?;
        // The sink's counters are read and restarted through the writer's inner handle.
        let sink = writer.inner_mut();
        self.sums.push(format!("{}:{}:{}:{:08x}", sink.start, sink.written, batch.num_rows(), sink.sum));
        (sink.start, sink.sum) = (sink.written, 0);
        Ok(())
    }

    /// Writes the rest and gives the file its name.
    pub(crate) fn finish(mut self) -> Result<(), FormatError> {
        self.flush()?;
        let Some(mut writer) = self.writer.take() else { return Ok(()) };
        if !self.said.is_empty() {
            let sum = super::sum(self.said.iter().map(|(k, v)| (*k, v.as_str())));
            writer.append_key_value_metadata(KeyValue::new(SAID.to_owned(), sum));
        }
        for (key, value) in std::mem::take(&mut self.said) {
            writer.append_key_value_metadata(KeyValue::new(key.to_owned(), value));
        }
        writer.append_key_value_metadata(KeyValue::new(SUMS.to_owned(), self.sums.join(",")));
        let refuse = |e| FormatError::file(&self.path, Cause::write(e));
        let sink = writer.into_inner().map_err(|e| FormatError::file(&self.path, cause(e)))?;
        let file = sink.file.into_inner().map_err(|e| refuse(e.into_error()))?;
        file.sync_all().map_err(refuse)?;
        fs::rename(&self.partial, &self.path).map_err(refuse)
    }
}

impl Drop for TableWriter {
    fn drop(&mut self) {
        // After `finish` there is no such file; an error here has nobody to be told to.
        let _ = fs::remove_file(&self.partial);
    }
}

/// The system's answer, where the error comes from it.
fn cause(error: ParquetError) -> Cause {
    match error {
        ParquetError::External(inner) => match inner.downcast::<io::Error>() {
            Ok(e) => Cause::write(*e),
            Err(e) => Cause::write(io::Error::other(e)),
        },
        other => Cause::write(io::Error::other(other)),
    }
}

/// A file that sums up what is written to it.
struct Summed {
    file: BufWriter<File>,
    written: u64,
    sum: u32,
    start: u64,
}

impl Write for Summed {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let n = self.file.write(buf)?;
        self.sum = crc32c::crc32c_append(self.sum, &buf[..n]);
        self.written += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
