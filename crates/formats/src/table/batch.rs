//! Decoding of row groups: the cells of each column, and the lists that they are in. Arrays of the library
//! would have to be built list by list.

use std::sync::Arc;

use arrow_schema::DataType;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::ArrowReaderMetadata;
use parquet::basic::Repetition;
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::data_type::{self, ByteArray};
use parquet::errors::{ParquetError, Result};
use parquet::file::reader::ChunkReader;
use parquet::schema::types::Type;

use super::group::Group;

/// Rows in memory.
pub struct Batch {
    rows: usize,
    columns: Vec<StoredColumn>,
}

/// A column of a batch.
pub(super) struct StoredColumn {
    name: String,
    /// Its type, as messages name it.
    pub(super) data_type: DataType,
    /// `None` for types that no column of this program has.
    pub(super) content: Option<Arc<Content>>,
}

/// Cells of a column.
pub(super) struct Content {
    /// By depth, outermost first, where each list begins among the lists of the next depth or the cells, and
    /// where the last one ends.
    pub(super) bounds: Vec<Vec<u32>>,
    /// Whether each cell has a value; `None` if all have one.
    pub(super) present: Option<Vec<bool>>,
    pub(super) cells: Cells,
}

/// Values of cells; any value for cells without one.
pub(super) enum Cells {
    Number(Vec<f64>),
    Whole(Vec<u32>),
    Signed(Vec<i64>),
    Text(Texts),
    Flag(Vec<bool>),
}

/// Maximum size of the texts of a column in a batch, bytes.
const MAX_TEXT: usize = 1 << 28;

/// Texts, one after another.
#[derive(Default)]
pub(super) struct Texts {
    all: String,
    ends: Vec<usize>,
}

impl Texts {
    pub(super) fn push(&mut self, text: &str) {
        self.all.push_str(text);
        self.ends.push(self.all.len());
    }

    pub(super) fn get(&self, i: usize) -> Option<&str> {
        let end = *self.ends.get(i)?;
        let start = i.checked_sub(1).map_or(0, |before| self.ends[before]);
        self.all.get(start..end)
    }
}

impl Batch {
    /// Returns the number of rows.
    pub fn num_rows(&self) -> usize {
        self.rows
    }

    pub(super) fn column(&self, name: &str) -> Option<&StoredColumn> {
        self.columns.iter().find(|column| column.name == name)
    }
}

/// Decoder of the columns of a row group.
pub(super) struct Decoder {
    columns: Vec<ColumnDecoder>,
}

impl Decoder {
    /// Begins to decode these columns.
    pub(super) fn new<R: ChunkReader + 'static>(
        metadata: &ArrowReaderMetadata,
        mask: &ProjectionMask,
        group: &Group<'_, R>,
    ) -> Result<Self> {
        let (schema, mut columns) = (metadata.parquet_schema(), Vec::new());
        for (leaf, described) in
            schema.columns().iter().enumerate().filter(|(leaf, _)| mask.leaf_included(*leaf))
        {
            let root = schema.get_column_root(leaf);
            let field = metadata.schema().field_with_name(root.name());
            columns.push(ColumnDecoder {
                name: root.name().to_owned(),
                data_type: field.map_or(DataType::Null, |field| field.data_type().clone()),
                element_levels: element_levels(root),
                level: described.max_def_level(),
                reader: get_column_reader(Arc::clone(described), group.pages(leaf)?),
            });
        }
        Ok(Self { columns })
    }

    /// Decodes the next rows.
    pub(super) fn read(&mut self, rows: usize) -> Result<Batch> {
        let columns = self.columns.iter_mut().map(|column| column.read(rows)).collect::<Result<_>>()?;
        Ok(Batch { rows, columns })
    }
}

/// Returns the definition levels from which on the lists of a column have an element, by depth.
fn element_levels(root: &Type) -> Vec<i16> {
    let (mut node, mut level, mut levels) = (root, 0, Vec::new());
    loop {
        match node.get_basic_info().repetition() {
            Repetition::REQUIRED => {}
            Repetition::OPTIONAL => level += 1,
            Repetition::REPEATED => {
                level += 1;
                levels.push(level);
            }
        }
        match node {
            Type::GroupType { fields, .. } if !fields.is_empty() => node = fields[0].as_ref(),
            _ => return levels,
        }
    }
}

struct ColumnDecoder {
    name: String,
    data_type: DataType,
    /// Definition levels from which on the lists have an element, by depth.
    element_levels: Vec<i16>,
    /// Definition level of cells with a value.
    level: i16,
    reader: ColumnReader,
}

impl ColumnDecoder {
    fn read(&mut self, rows: usize) -> Result<StoredColumn> {
        let content = self.content(rows)?.map(Arc::new);
        Ok(StoredColumn { name: self.name.clone(), data_type: self.data_type.clone(), content })
    }

    fn content(&mut self, rows: usize) -> Result<Option<Content>> {
        let (mut leaf, mut depth) = (&self.data_type, 0);
        while let DataType::List(element) = leaf {
            (leaf, depth) = (element.data_type(), depth + 1);
        }
        if depth != self.element_levels.len() {
            return Ok(None);
        }
        let levels = Levels { elements: &self.element_levels, value: self.level };
        let content = match (leaf, &mut self.reader) {
            (DataType::Float64, ColumnReader::DoubleColumnReader(reader)) => {
                read(reader, rows, levels, |values, present| Ok(Cells::Number(spread(values, present))))
            }
            (DataType::Float32, ColumnReader::FloatColumnReader(reader)) => {
                read(reader, rows, levels, |values, present| {
                    Ok(Cells::Number(spread(values.into_iter().map(f64::from).collect(), present)))
                })
            }
            (DataType::UInt32, ColumnReader::Int32ColumnReader(reader)) => {
                read(reader, rows, levels, |values, present| {
                    Ok(Cells::Whole(spread(values.into_iter().map(i32::cast_unsigned).collect(), present)))
                })
            }
            (DataType::Int32, ColumnReader::Int32ColumnReader(reader)) => {
                read(reader, rows, levels, |values, present| {
                    Ok(Cells::Signed(spread(values.into_iter().map(i64::from).collect(), present)))
                })
            }
            (DataType::Int64, ColumnReader::Int64ColumnReader(reader)) => {
                read(reader, rows, levels, |values, present| Ok(Cells::Signed(spread(values, present))))
            }
            (DataType::Boolean, ColumnReader::BoolColumnReader(reader)) => {
                read(reader, rows, levels, |values, present| Ok(Cells::Flag(spread(values, present))))
            }
            (DataType::Utf8, ColumnReader::ByteArrayColumnReader(reader)) => {
                read(reader, rows, levels, |values, present| texts(&values, present).map(Cells::Text))
            }
            _ => return Ok(None),
        };
        content.map(Some)
    }
}

/// Definition levels of a column.
#[derive(Clone, Copy)]
struct Levels<'a> {
    /// From which on the lists have an element, by depth.
    elements: &'a [i16],
    /// Of cells with a value.
    value: i16,
}

/// Reads rows of a column. `cells` converts the values; it also gets which cells have one, if not all have.
fn read<T: data_type::DataType>(
    reader: &mut ColumnReaderImpl<T>,
    rows: usize,
    levels: Levels<'_>,
    cells: impl FnOnce(Vec<T::T>, Option<&[bool]>) -> Result<Cells>,
) -> Result<Content> {
    let (mut values, mut definitions, mut repetitions) = (Vec::new(), Vec::new(), Vec::new());
    let read = reader.read_records(rows, Some(&mut definitions), Some(&mut repetitions), &mut values)?;
    if read.0 < rows {
        return Err(ParquetError::General(format!("{} rows are missing", rows - read.0)));
    }
    let bounds = levels.bounds(&definitions, &repetitions);
    let present = levels.present(&definitions, values.len());
    let (cells_in_lists, all) =
        (bounds.last().and_then(|ends| ends.last()), present.as_ref().map_or(values.len(), Vec::len));
    if cells_in_lists.is_some_and(|cells| *cells as usize != all) {
        return Err(ParquetError::General("lists and cells do not match".into()));
    }
    Ok(Content { bounds, cells: cells(values, present.as_deref())?, present })
}

impl Levels<'_> {
    /// Returns where the lists of each depth begin, and where the last one ends.
    fn bounds(&self, definitions: &[i16], repetitions: &[i16]) -> Vec<Vec<u32>> {
        let depth = self.elements.len();
        let Some(innermost) = self.elements.last() else { return Vec::new() };
        let (mut bounds, mut cells) = (vec![Vec::new(); depth], 0);
        // The beginning of a list at depth `k`, or its end: what was counted so far of what it contains.
        let put = |bounds: &mut [Vec<u32>], k: usize, cells: u32| {
            let next = bounds.get(k + 1).map_or(cells, |inner| inner.len() as u32);
            bounds[k].push(next);
        };
        let mut at = 0;
        while let (Some(definition), Some(repetition)) = (definitions.get(at), repetitions.get(at)) {
            // The list at this depth goes on, and each list within its next element begins.
            for k in usize::try_from(*repetition).unwrap_or(0)..depth {
                if k > 0 && *definition < self.elements[k - 1] {
                    break;
                }
                put(&mut bounds, k, cells);
            }
            at += 1;
            // The other cells of an innermost list.
            let others = repetitions[at..].iter().take_while(|r| usize::try_from(**r) == Ok(depth)).count();
            cells += u32::from(definition >= innermost) + others as u32;
            at += others;
        }
        (0..depth).for_each(|k| put(&mut bounds, k, cells));
        bounds
    }

    /// Returns which cells have a value, `None` if all have. Definition levels of empty lists are no cells.
    fn present(&self, definitions: &[i16], values: usize) -> Option<Vec<bool>> {
        let cell = self.elements.last().copied().unwrap_or(0);
        let cells = definitions.iter().filter(|definition| **definition >= cell);
        // Columns in which every cell has a value may be without definition levels.
        let all_present = cells.clone().count() <= values;
        (!all_present).then(|| cells.map(|definition| *definition == self.value).collect())
    }
}

/// Returns values in the order of the cells, with any value for cells without one.
fn spread<T: Copy + Default>(values: Vec<T>, present: Option<&[bool]>) -> Vec<T> {
    let Some(present) = present else { return values };
    let mut values = values.into_iter();
    let mut next = || values.next().unwrap_or_default();
    present.iter().map(|is_present| if *is_present { next() } else { T::default() }).collect()
}

fn texts(values: &[ByteArray], present: Option<&[bool]>) -> Result<Texts> {
    // A text of a dictionary may occur any number of times without space in the file.
    let length = values.iter().try_fold(0_usize, |sum, value| sum.checked_add(value.len()));
    if length.is_none_or(|length| length > MAX_TEXT) {
        return Err(ParquetError::General(format!("the texts of a column have more than {MAX_TEXT} bytes")));
    }
    let (mut texts, mut values) = (Texts::default(), values.iter());
    let cells = present.map_or(values.len(), <[bool]>::len);
    for cell in 0..cells {
        let value = present.is_none_or(|present| present[cell]).then(|| values.next()).flatten();
        texts.push(value.map_or(Ok(""), ByteArray::as_utf8)?);
    }
    Ok(texts)
}
