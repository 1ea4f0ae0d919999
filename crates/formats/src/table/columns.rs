//! Columns of nested lists: filled value by value, read as ranges of cells.

use std::ops::Range;
use std::sync::Arc;

use arrow_array::builder::{BooleanBufferBuilder, StringBuilder};
use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Int32Type, Int64Type, UInt32Type};
use arrow_array::{
    Array, ArrayRef, BooleanArray, Float64Array, ListArray, RecordBatch, StringArray, UInt32Array,
};
use arrow_buffer::{NullBuffer, OffsetBuffer};
use arrow_schema::{DataType, Field};

use crate::error::Cause;

/// Type of the innermost cells of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leaf {
    /// `f64`.
    Number,
    /// `u32`.
    Whole,
    /// UTF-8.
    Text,
    /// `bool`.
    Flag,
}

/// Value of a cell.
#[derive(Clone, Copy, Debug)]
pub enum Value<'a> {
    /// Cell of [`Leaf::Number`].
    Number(f64),
    /// Cell of [`Leaf::Whole`].
    Whole(u32),
    /// Cell of [`Leaf::Text`].
    Text(&'a str),
    /// Cell of [`Leaf::Flag`].
    Flag(bool),
    /// Empty cell of any type.
    Null,
}

impl From<Option<f64>> for Value<'_> {
    fn from(v: Option<f64>) -> Self {
        v.map_or(Self::Null, Self::Number)
    }
}

impl<'a> From<Option<&'a str>> for Value<'a> {
    fn from(v: Option<&'a str>) -> Self {
        v.map_or(Self::Null, Self::Text)
    }
}

/// A column being filled.
pub struct Column {
    name: &'static str,
    leaf: Leaf,
    nullable: bool,
    /// Ends of the lists, by depth, outermost first; the elements of a list are the lists of the next depth.
    ends: Vec<Vec<i32>>,
    numbers: Vec<f64>,
    wholes: Vec<u32>,
    texts: StringBuilder,
    flags: BooleanBufferBuilder,
    present: BooleanBufferBuilder,
}

impl Column {
    /// Creates an empty column of lists of nesting depth `depth` (0: plain cells).
    pub fn new(name: &'static str, leaf: Leaf, depth: usize, nullable: bool) -> Self {
        Self {
            name,
            leaf,
            nullable,
            ends: vec![vec![0]; depth],
            numbers: Vec::new(),
            wholes: Vec::new(),
            texts: StringBuilder::new(),
            flags: BooleanBufferBuilder::new(0),
            present: BooleanBufferBuilder::new(0),
        }
    }

    /// Returns the name of the column.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Returns the arrow field. List elements are called `element`, as the Parquet standard requires.
    pub(crate) fn field(&self) -> Field {
        let leaf = match self.leaf {
            Leaf::Number => DataType::Float64,
            Leaf::Whole => DataType::UInt32,
            Leaf::Text => DataType::Utf8,
            Leaf::Flag => DataType::Boolean,
        };
        let (mut name, mut data, mut nullable) = (self.name, leaf, self.nullable);
        for depth in (0..self.ends.len()).rev() {
            let element = Field::new("element", data, nullable);
            (data, nullable) = (DataType::List(Arc::new(element)), false);
            name = if depth == 0 { self.name } else { "element" };
        }
        Field::new(name, data, nullable)
    }

    /// Returns the path of the leaf in the Parquet schema.
    pub(crate) fn path(&self) -> String {
        format!("{}{}", self.name, ".list.element".repeat(self.ends.len()))
    }

    pub(crate) fn leaf(&self) -> Leaf {
        self.leaf
    }

    /// Adds one cell.
    pub fn push(&mut self, value: Value<'_>) {
        self.present.append(!matches!(value, Value::Null));
        match (self.leaf, value) {
            (Leaf::Number, Value::Number(v)) => self.numbers.push(v),
            (Leaf::Number, _) => self.numbers.push(0.0),
            (Leaf::Whole, Value::Whole(v)) => self.wholes.push(v),
            (Leaf::Whole, _) => self.wholes.push(0),
            (Leaf::Text, Value::Text(v)) => self.texts.append_value(v),
            (Leaf::Text, _) => self.texts.append_value(""),
            (Leaf::Flag, value) => self.flags.append(matches!(value, Value::Flag(true))),
        }
    }

    /// Ends the list at this depth: it contains everything added since the previous end.
    fn close(&mut self, depth: usize) {
        let cells = self.present.len() as i32;
        let end = self.ends.get(depth + 1).map_or(cells, |inner| inner.len() as i32 - 1);
        self.ends[depth].push(end);
    }

    /// Adds a row of a column of depth 1.
    pub fn list<'a>(&mut self, cells: impl IntoIterator<Item = Value<'a>>) {
        cells.into_iter().for_each(|v| self.push(v));
        self.close(0);
    }

    /// Adds a row of a column of depth 2.
    pub(crate) fn lists<'a, I: IntoIterator<Item = Value<'a>>>(&mut self, rows: impl IntoIterator<Item = I>) {
        for row in rows {
            row.into_iter().for_each(|v| self.push(v));
            self.close(1);
        }
        self.close(0);
    }

    /// Adds a row of a column of depth 3.
    pub(crate) fn nested<'a, I, J>(&mut self, rows: impl IntoIterator<Item = J>)
    where
        I: IntoIterator<Item = Value<'a>>,
        J: IntoIterator<Item = I>,
    {
        for row in rows {
            for cells in row {
                cells.into_iter().for_each(|v| self.push(v));
                self.close(2);
            }
            self.close(1);
        }
        self.close(0);
    }

    /// Returns the rows added so far as an array and empties the column.
    pub fn take(&mut self) -> ArrayRef {
        let mut fields = vec![self.field()];
        while let DataType::List(inner) = fields[fields.len() - 1].data_type() {
            let inner = inner.as_ref().clone();
            fields.push(inner);
        }
        let present = self.present.finish();
        let nulls = self.nullable.then(|| NullBuffer::new(present));
        let mut array: ArrayRef = match self.leaf {
            Leaf::Number => Arc::new(Float64Array::new(std::mem::take(&mut self.numbers).into(), nulls)),
            Leaf::Whole => Arc::new(UInt32Array::new(std::mem::take(&mut self.wholes).into(), nulls)),
            Leaf::Flag => Arc::new(BooleanArray::new(self.flags.finish(), nulls)),
            Leaf::Text => {
                let (offsets, data, _) = self.texts.finish().into_parts();
                Arc::new(StringArray::new(offsets, data, nulls))
            }
        };
        for depth in (0..self.ends.len()).rev() {
            let ends = std::mem::replace(&mut self.ends[depth], vec![0]);
            let element = Arc::new(fields[depth + 1].clone());
            array = Arc::new(ListArray::new(element, OffsetBuffer::new(ends.into()), array, None));
        }
        array
    }
}

/// A column of a file that is read.
pub struct View {
    name: &'static str,
    offsets: Vec<OffsetBuffer<i32>>,
    cells: Cells,
}

/// Returns a whole number as text.
fn decimal<T: ToString>(number: Option<T>) -> Option<String> {
    number.map(|number| number.to_string())
}

/// Innermost cells of a column.
enum Cells {
    Number(Float64Array),
    Whole(UInt32Array),
    Text(StringArray),
    Flag(BooleanArray),
}

impl View {
    /// Finds a column by name and checks the nesting depth of its lists and the type of its cells. `None` if
    /// it is missing.
    pub(crate) fn find(
        batch: &RecordBatch,
        name: &'static str,
        leaf: Leaf,
        depth: usize,
    ) -> Result<Option<Self>, Cause> {
        let Some(column) = batch.column_by_name(name) else { return Ok(None) };
        let refuse = || {
            let lists = "list of ".repeat(depth);
            let kind = match leaf {
                Leaf::Number => "float64",
                Leaf::Whole => "uint32",
                Leaf::Text => "string",
                Leaf::Flag => "boolean",
            };
            Cause::schema(format!("column `{name}`"), column.data_type(), format!("{lists}{kind}"))
        };
        let (mut array, mut offsets) = (column.clone(), Vec::with_capacity(depth));
        for _ in 0..depth {
            let list = array.as_list_opt::<i32>().ok_or_else(refuse)?;
            offsets.push(list.offsets().clone());
            array = list.values().clone();
        }
        let cells = match (leaf, array.data_type()) {
            (Leaf::Number, DataType::Float64) => Cells::Number(array.as_primitive().clone()),
            (Leaf::Whole, DataType::UInt32) => Cells::Whole(array.as_primitive().clone()),
            (Leaf::Text, DataType::Utf8) => Cells::Text(array.as_string().clone()),
            (Leaf::Flag, DataType::Boolean) => Cells::Flag(array.as_boolean().clone()),
            // Other programs write narrower numbers and signed whole numbers.
            (Leaf::Number, DataType::Float32) => {
                Cells::Number(array.as_primitive::<Float32Type>().unary(f64::from))
            }
            (Leaf::Number, DataType::Int64) => {
                Cells::Number(array.as_primitive::<Int64Type>().unary(|v| v as f64))
            }
            (Leaf::Number, DataType::Int32) => {
                Cells::Number(array.as_primitive::<Int32Type>().unary(f64::from))
            }
            (Leaf::Whole, DataType::Int64) => {
                let whole = array.as_primitive::<Int64Type>();
                Cells::Whole(whole.try_unary::<_, UInt32Type, _>(u32::try_from).map_err(|_| refuse())?)
            }
            (Leaf::Whole, DataType::Int32) => {
                let whole = array.as_primitive::<Int32Type>();
                Cells::Whole(whole.try_unary::<_, UInt32Type, _>(u32::try_from).map_err(|_| refuse())?)
            }
            // Ids of other programs may be whole numbers.
            (Leaf::Text, DataType::Int64) => {
                Cells::Text(array.as_primitive::<Int64Type>().iter().map(decimal).collect())
            }
            (Leaf::Text, DataType::Int32) => {
                Cells::Text(array.as_primitive::<Int32Type>().iter().map(decimal).collect())
            }
            _ => return Err(refuse()),
        };
        Ok(Some(Self { name, offsets, cells }))
    }

    /// Returns a required column by name.
    pub fn need(batch: &RecordBatch, name: &'static str, leaf: Leaf, depth: usize) -> Result<Self, Cause> {
        Self::find(batch, name, leaf, depth)?
            .ok_or_else(|| Cause::schema(format!("column `{name}`"), "missing", "present"))
    }

    /// Returns the range of cells, or of lists of the next depth, in list `i` of this depth.
    pub fn range(&self, depth: usize, i: usize) -> Range<usize> {
        let ends = &self.offsets[depth];
        match (ends.get(i), ends.get(i + 1)) {
            (Some(&a), Some(&b)) if a >= 0 && b >= a => a as usize..b as usize,
            _ => 0..0,
        }
    }

    /// Returns the number in a cell; `None` for null.
    pub fn number(&self, cell: usize) -> Option<f64> {
        let Cells::Number(array) = &self.cells else { return None };
        (cell < array.len() && array.is_valid(cell)).then(|| array.value(cell))
    }

    /// Returns all numbers of the column, and whether none of them is null.
    pub(crate) fn numbers(&self) -> (&[f64], bool) {
        match &self.cells {
            Cells::Number(array) => (array.values(), array.null_count() == 0),
            _ => (&[], false),
        }
    }

    /// Returns the whole number in a cell; `None` for null.
    pub fn whole(&self, cell: usize) -> Option<u32> {
        let Cells::Whole(array) = &self.cells else { return None };
        (cell < array.len() && array.is_valid(cell)).then(|| array.value(cell))
    }

    /// Returns the flag in a cell; `None` for null.
    pub fn flag(&self, cell: usize) -> Option<bool> {
        let Cells::Flag(array) = &self.cells else { return None };
        (cell < array.len() && array.is_valid(cell)).then(|| array.value(cell))
    }

    /// Returns the text in a cell; `None` for null.
    pub fn text(&self, cell: usize) -> Option<&str> {
        let Cells::Text(array) = &self.cells else { return None };
        (cell < array.len() && array.is_valid(cell)).then(|| array.value(cell))
    }

    /// Returns the name of the column.
    pub fn name(&self) -> &'static str {
        self.name
    }
}
