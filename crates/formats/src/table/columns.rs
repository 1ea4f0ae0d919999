//! Columns of nested lists: filled value by value, read as ranges of cells.

use std::ops::Range;
use std::sync::Arc;

use arrow_array::builder::{BooleanBufferBuilder, StringBuilder};
use arrow_array::{ArrayRef, BooleanArray, Float64Array, ListArray, StringArray, UInt32Array};
use arrow_buffer::{NullBuffer, OffsetBuffer};
use arrow_schema::{DataType, Field};

use super::batch::{Batch, Cells, Content, Texts};
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
    content: Arc<Content>,
}

impl View {
    /// Finds a column by name and checks the nesting depth of its lists and the type of its cells. `None` if
    /// it is missing.
    pub fn find(batch: &Batch, name: &'static str, leaf: Leaf, depth: usize) -> Result<Option<Self>, Cause> {
        let Some(column) = batch.column(name) else { return Ok(None) };
        let refuse = || {
            let lists = "list of ".repeat(depth);
            let kind = match leaf {
                Leaf::Number => "float64",
                Leaf::Whole => "uint32",
                Leaf::Text => "string",
                Leaf::Flag => "boolean",
            };
            Cause::schema(format!("column `{name}`"), &column.data_type, format!("{lists}{kind}"))
        };
        let stored = column.content.as_ref().filter(|content| content.bounds.len() == depth);
        let stored = stored.ok_or_else(refuse)?;
        let cells = match (leaf, &stored.cells) {
            (Leaf::Number, Cells::Number(_))
            | (Leaf::Whole, Cells::Whole(_))
            | (Leaf::Text, Cells::Text(_))
            | (Leaf::Flag, Cells::Flag(_)) => return Ok(Some(Self { name, content: Arc::clone(stored) })),
            // Other programs write signed whole numbers, also as ids.
            (Leaf::Number, Cells::Signed(all)) => Cells::Number(all.iter().map(|v| *v as f64).collect()),
            (Leaf::Whole, Cells::Signed(all)) => {
                let whole = all.iter().map(|v| u32::try_from(*v));
                Cells::Whole(whole.collect::<Result<_, _>>().map_err(|_| refuse())?)
            }
            (Leaf::Text, Cells::Signed(all)) => {
                let mut texts = Texts::default();
                all.iter().for_each(|v| texts.push(&v.to_string()));
                Cells::Text(texts)
            }
            _ => return Err(refuse()),
        };
        let content = Content { bounds: stored.bounds.clone(), present: stored.present.clone(), cells };
        Ok(Some(Self { name, content: Arc::new(content) }))
    }

    /// Returns a required column by name.
    pub fn need(batch: &Batch, name: &'static str, leaf: Leaf, depth: usize) -> Result<Self, Cause> {
        Self::find(batch, name, leaf, depth)?
            .ok_or_else(|| Cause::schema(format!("column `{name}`"), "missing", "present"))
    }

    /// Returns the range of cells, or of lists of the next depth, in list `i` of this depth.
    pub fn range(&self, depth: usize, i: usize) -> Range<usize> {
        let bounds = &self.content.bounds[depth];
        match (bounds.get(i), bounds.get(i + 1)) {
            (Some(&start), Some(&end)) => start as usize..end as usize,
            _ => 0..0,
        }
    }

    /// Returns the cell if it has a value.
    fn present(&self, cell: usize) -> Option<usize> {
        let is_present = |present: &Vec<bool>| present.get(cell) == Some(&true);
        self.content.present.as_ref().is_none_or(is_present).then_some(cell)
    }

    /// Returns the number in a cell; `None` for null.
    pub fn number(&self, cell: usize) -> Option<f64> {
        let Cells::Number(numbers) = &self.content.cells else { return None };
        self.present(cell).and_then(|cell| numbers.get(cell).copied())
    }

    /// Returns the numbers in a range of cells, and which of them are not null, `None` if the column has no
    /// null.
    pub(crate) fn numbers(&self, cells: Range<usize>) -> (&[f64], Option<&[bool]>) {
        let Cells::Number(numbers) = &self.content.cells else { return (&[], None) };
        let present = self.content.present.as_ref().map(|present| &present[cells.clone()]);
        (&numbers[cells], present)
    }

    /// Returns the whole number in a cell; `None` for null.
    pub fn whole(&self, cell: usize) -> Option<u32> {
        let Cells::Whole(numbers) = &self.content.cells else { return None };
        self.present(cell).and_then(|cell| numbers.get(cell).copied())
    }

    /// Returns the flag in a cell; `None` for null.
    pub fn flag(&self, cell: usize) -> Option<bool> {
        let Cells::Flag(flags) = &self.content.cells else { return None };
        self.present(cell).and_then(|cell| flags.get(cell).copied())
    }

    /// Returns the text in a cell; `None` for null.
    pub fn text(&self, cell: usize) -> Option<&str> {
        let Cells::Text(texts) = &self.content.cells else { return None };
        self.present(cell).and_then(|cell| texts.get(cell))
    }

    /// Returns the name of the column.
    pub fn name(&self) -> &'static str {
        self.name
    }
}
