//! numpy arrays of numbers.

use std::ops::Range;

/// Number type of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Dtype {
    pub(super) kind: Kind,
    /// Size of one number in bytes.
    pub(super) size: usize,
    pub(super) big_endian: bool,
}

/// Interpretation of the bytes of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Bool,
    Signed,
    Unsigned,
    Float,
    /// Any Python value: such an array contains a list.
    Object,
}

impl Dtype {
    /// Parses numpy's short name, such as `f4`, with an optional prefix for the byte order.
    pub(super) fn from_name(name: &str) -> Option<Self> {
        let (big_endian, code) = match name.strip_prefix(['<', '=', '|']) {
            Some(code) => (false, code),
            None => name.strip_prefix('>').map_or((false, name), |code| (true, code)),
        };
        let (kind, size) = match code {
            "b1" => (Kind::Bool, 1),
            "i1" => (Kind::Signed, 1),
            "i2" => (Kind::Signed, 2),
            "i4" => (Kind::Signed, 4),
            "i8" => (Kind::Signed, 8),
            "u1" => (Kind::Unsigned, 1),
            "u2" => (Kind::Unsigned, 2),
            "u4" => (Kind::Unsigned, 4),
            "u8" => (Kind::Unsigned, 8),
            "f4" => (Kind::Float, 4),
            "f8" => (Kind::Float, 8),
            "O" | "O8" => (Kind::Object, 8),
            _ => return None,
        };
        Some(Self { kind, size, big_endian })
    }

    /// Decodes a number from [`Dtype::size`] bytes.
    pub(super) fn number(self, bytes: &[u8]) -> f64 {
        let mut little = [0_u8; 8];
        let n = self.size.min(bytes.len()).min(8);
        little[..n].copy_from_slice(&bytes[..n]);
        if self.big_endian {
            little[..n].reverse();
        }
        let unsigned = u64::from_le_bytes(little);
        match self.kind {
            Kind::Bool => f64::from(u8::from(unsigned != 0)),
            Kind::Unsigned => unsigned as f64,
            Kind::Signed => {
                let unused = 64 - 8 * n.max(1) as u32;
                (((unsigned << unused) as i64) >> unused) as f64
            }
            Kind::Float if n == 4 => f64::from(f32::from_bits(unsigned as u32)),
            Kind::Float => f64::from_bits(unsigned),
            Kind::Object => f64::NAN,
        }
    }
}

/// Location of an array's content.
#[derive(Clone, Debug)]
pub(super) enum Content {
    /// Not yet known.
    Missing,
    /// Byte range of the file.
    File(Range<u32>),
    /// Value of the pickle: encoded bytes, or the list of an array of objects.
    Value(super::Id),
}

/// An array of at most two dimensions.
#[derive(Clone, Debug)]
pub(super) struct Array {
    pub(super) dtype: Dtype,
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Whether the numbers are stored column by column (Fortran order).
    pub(super) by_column: bool,
    pub(super) content: Content,
}

impl Array {
    /// Creates an array that is filled later.
    pub(super) fn empty() -> Self {
        let dtype = Dtype { kind: Kind::Unsigned, size: 1, big_endian: false };
        Self { dtype, rows: 0, columns: 1, by_column: false, content: Content::Missing }
    }
}

/// Numbers in rows and columns.
pub(crate) struct Grid<'a> {
    pub rows: usize,
    pub columns: usize,
    pub(super) numbers: Numbers<'a>,
}

/// Numbers of a grid.
pub(super) enum Numbers<'a> {
    Raw { bytes: &'a [u8], dtype: Dtype, by_column: bool },
    Listed(Vec<f64>),
}

impl Grid<'_> {
    /// Returns the number in a row and a column; NaN if they do not exist.
    pub(crate) fn at(&self, row: usize, column: usize) -> f64 {
        if row >= self.rows || column >= self.columns {
            return f64::NAN;
        }
        match &self.numbers {
            Numbers::Listed(all) => all.get(row * self.columns + column).copied().unwrap_or(f64::NAN),
            Numbers::Raw { bytes, dtype, by_column } => {
                let i = if *by_column { column * self.rows + row } else { row * self.columns + column };
                let range = i * dtype.size..(i + 1) * dtype.size;
                bytes.get(range).map_or(f64::NAN, |b| dtype.number(b))
            }
        }
    }
}
