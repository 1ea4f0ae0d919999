//! Writing of Parquet files that are complete or absent.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_writer::ArrowWriterOptions;
use parquet::basic::Encoding;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::EnabledStatistics;
use parquet::schema::types::ColumnPath;
use reactsim_files::NewFile;

use super::columns::{Column, Leaf};
use super::reader::TableReader;
use super::{GROUP_CHECKSUMS, KIND, METADATA_CHECKSUM, VERSION, properties};
use crate::error::{Cause, FormatError};

/// Writer of a Parquet file. The file gets its final name in [`TableWriter::finish`]; dropping the writer
/// before removes the file.
pub struct TableWriter {
    path: PathBuf,
    columns: Vec<Column>,
    schema: Arc<Schema>,
    writer: Option<ArrowWriter<ChecksumWriter>>,
    /// Checksums of the row groups written so far.
    checksums: Vec<String>,
    /// Number of rows of a row group.
    group_size: usize,
    /// Number of rows not written yet.
    pending: usize,
    /// Metadata in addition to kind and version.
    metadata: Vec<(&'static str, String)>,
}

impl TableWriter {
    /// Starts a file of a kind and version, with row groups of `group_size` rows. It replaces an existing
    /// file only if that is empty or of the same kind.
    pub fn create(
        path: &Path,
        (kind, version): (&str, u32),
        group_size: usize,
        columns: Vec<Column>,
    ) -> Result<Self, FormatError> {
        let refuse = |e| FormatError::file(path, Cause::Io { doing: "create", source: e });
        let is_empty = path.metadata().is_ok_and(|metadata| metadata.len() == 0);
        if path.is_file() && !is_empty && !super::kind(path).is_ok_and(|found| found.as_deref() == Some(kind))
        {
            return Err(refuse(io::Error::new(
                io::ErrorKind::AlreadyExists,
                "there is another file of this name; remove it or choose another name",
            )));
        }
        let file = NewFile::create(path).map_err(refuse)?;
        let schema = Arc::new(Schema::new(columns.iter().map(Column::field).collect::<Vec<_>>()));
        let key = |k: &str, v: String| KeyValue::new(k.to_owned(), v);
        let mut properties = properties()
            .set_statistics_enabled(EnabledStatistics::None)
            .set_offset_index_disabled(true)
            .set_dictionary_enabled(false)
            .set_key_value_metadata(Some(vec![
                key(KIND, kind.to_owned()),
                key(VERSION, version.to_string()),
            ]));
        for column in &columns {
            let path = ColumnPath::from(column.path().split('.').map(str::to_owned).collect::<Vec<_>>());
            properties = match column.leaf() {
                // Coordinates share their high bytes: splitting by byte reduces their size by a third.
                Leaf::Number => properties.set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT),
                Leaf::Text => properties.set_column_dictionary_enabled(path, true),
                Leaf::Whole | Leaf::Flag => properties,
            };
        }
        let sink = ChecksumWriter { file, written: 0, checksum: 0, start: 0 };
        let options =
            ArrowWriterOptions::new().with_properties(properties.build()).with_skip_arrow_metadata(true);
        let writer = ArrowWriter::try_new_with_options(sink, schema.clone(), options)
            .map_err(|e| FormatError::file(path, cause(e)))?;
        Ok(Self {
            path: path.to_owned(),
            columns,
            schema,
            writer: Some(writer),
            checksums: Vec::new(),
            group_size,
            pending: 0,
            metadata: Vec::new(),
        })
    }

    /// Returns the column of this name, to be filled.
    ///
    /// # Panics
    /// If the file has no such column: the schema is defined by this program.
    pub fn column(&mut self, name: &str) -> &mut Column {
        self.columns.iter_mut().find(|c| c.name() == name).expect("columns are named as in the schema")
    }

    /// Adds an entry to the file's metadata; a checksum covers all entries added this way.
    pub fn add_metadata(&mut self, key: &'static str, value: String) {
        self.metadata.push((key, value));
    }

    /// Ends a row; every column must have received its cells.
    pub fn end_row(&mut self) -> Result<(), FormatError> {
        self.pending += 1;
        if self.pending < self.group_size { Ok(()) } else { self.flush() }
    }

    /// Writes the pending rows as one row group.
    pub fn flush(&mut self) -> Result<(), FormatError> {
        self.pending = 0;
        let arrays = self.columns.iter_mut().map(Column::take).collect();
        let refuse = |e| FormatError::file(&self.path, cause(e));
        let Some(writer) = &mut self.writer else { return Ok(()) };
        let batch = RecordBatch::try_new(self.schema.clone(), arrays).map_err(|e| refuse(e.into()))?;
        if batch.num_rows() == 0 {
            return Ok(());
        }
        writer.write(&batch).map_err(refuse)?;
        writer.flush().map_err(refuse)?;
        // Data in the Parquet writer's own buffer belong to the checksum of this row group.
        writer.sync().map_err(|e| refuse(e.into()))?;
        let sink = writer.inner_mut();
        self.checksums.push(format!(
            "{}:{}:{}:{:08x}",
            sink.start,
            sink.written,
            batch.num_rows(),
            sink.checksum
        ));
        (sink.start, sink.checksum) = (sink.written, 0);
        Ok(())
    }

    /// Writes the remaining rows and gives the file its final name.
    pub fn finish(self) -> Result<(), FormatError> {
        let path = self.path.clone();
        self.close()?.finish().map_err(|e| FormatError::file(&path, Cause::write(e)))
    }

    /// Writes the remaining rows, and reads the file back. It has no name, and disappears with the reader.
    pub fn read_back(self) -> Result<TableReader, FormatError> {
        let path = self.path.clone();
        TableReader::over(&path, Box::new(self.close()?))
    }

    /// Writes the remaining rows and gives the file the name of a part, which is returned
    /// ([`NewFile::finish_part`]).
    pub fn finish_part(self) -> Result<PathBuf, FormatError> {
        let path = self.path.clone();
        self.close()?.finish_part().map_err(|e| FormatError::file(&path, Cause::write(e)))
    }

    /// Writes the remaining rows and the metadata. Returns the file, which has no name yet.
    fn close(mut self) -> Result<NewFile, FormatError> {
        self.flush()?;
        let mut writer = self.writer.take().expect("it is taken only here");
        if !self.metadata.is_empty() {
            let sum = super::metadata_checksum(self.metadata.iter().map(|(k, v)| (*k, v.as_str())));
            writer.append_key_value_metadata(KeyValue::new(METADATA_CHECKSUM.to_owned(), sum));
        }
        for (key, value) in std::mem::take(&mut self.metadata) {
            writer.append_key_value_metadata(KeyValue::new(key.to_owned(), value));
        }
        writer.append_key_value_metadata(KeyValue::new(GROUP_CHECKSUMS.to_owned(), self.checksums.join(",")));
        let sink = writer.into_inner().map_err(|e| FormatError::file(&self.path, cause(e)))?;
        Ok(sink.file)
    }
}

/// Converts a Parquet error, keeping an operating system error inside it.
fn cause(error: ParquetError) -> Cause {
    match error {
        ParquetError::External(inner) => match inner.downcast::<io::Error>() {
            Ok(e) => Cause::write(*e),
            Err(e) => Cause::write(io::Error::other(e)),
        },
        other => Cause::write(io::Error::other(other)),
    }
}

/// File writer that computes a checksum of the written bytes.
struct ChecksumWriter {
    file: NewFile,
    /// Number of bytes written.
    written: u64,
    /// Checksum since `start`.
    checksum: u32,
    /// Offset of the current row group.
    start: u64,
}

impl Write for ChecksumWriter {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        let n = self.file.write(buf)?;
        self.checksum = crc32c::crc32c_append(self.checksum, &buf[..n]);
        self.written += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
