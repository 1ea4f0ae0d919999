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
    /// Texts and others, which are not read.
    Other,
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
            "f2" => (Kind::Float, 2),
            "f4" => (Kind::Float, 4),
            "f8" => (Kind::Float, 8),
            "O" | "O8" => (Kind::Object, 8),
            _ => return None,
        };
        Some(Self { kind, size, big_endian })
    }

    /// Parses numpy's short name of a type of texts, times, complex numbers or bytes.
    pub(super) fn other(name: &str) -> Option<Self> {
        let code = name.trim_start_matches(['<', '=', '|', '>']);
        let (kind, length) = code.split_at_checked(1).filter(|(kind, _)| "SUVacmM".contains(kind))?;
        let size = length.parse::<usize>().ok()?.checked_mul(if kind == "U" { 4 } else { 1 })?;
        Some(Self { kind: Kind::Other, size, big_endian: false })
    }

    pub(super) fn is_number(self) -> bool {
        !matches!(self.kind, Kind::Object | Kind::Other)
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
            Kind::Float if n == 2 => half(unsigned),
            Kind::Float if n == 4 => f64::from(f32::from_bits(unsigned as u32)),
            Kind::Float => f64::from_bits(unsigned),
            Kind::Object | Kind::Other => f64::NAN,
        }
    }
}

/// Decodes a number of 16 bits: a sign, an exponent of 5 bits and a fraction of 10.
fn half(bits: u64) -> f64 {
    let (exponent, fraction) = (bits >> 10 & 0x1f, bits & 0x3ff);
    let size = match exponent {
        0 => fraction as f64 / f64::from(1_u32 << 24),
        0x1f => f64::from_bits(0x7ff << 52 | fraction << 42),
        _ => f64::from_bits((exponent + 1008) << 52 | fraction << 42),
    };
    if bits >> 15 == 0 { size } else { -size }
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

/// An array of numbers in planes, rows and columns, of which arrays of fewer dimensions have one.
#[derive(Clone, Debug)]
pub(super) struct Array {
    pub(super) dtype: Dtype,
    /// Numbers of planes, rows and columns.
    pub(super) shape: [usize; 3],
    /// Distances between successive planes, rows and columns, in numbers.
    pub(super) strides: [usize; 3],
    /// Offset of the first number in the content, in bytes.
    pub(super) start: usize,
    pub(super) content: Content,
}

impl Array {
    /// Creates an array that is filled later.
    pub(super) fn empty() -> Self {
        let dtype = Dtype { kind: Kind::Unsigned, size: 1, big_endian: false };
        Self { dtype, shape: [1, 0, 1], strides: [0, 1, 0], start: 0, content: Content::Missing }
    }

    /// Returns the shape as Python displays it.
    pub(super) fn shown(&self) -> String {
        let [planes, rows, columns] = self.shape;
        if planes == 1 { format!("({rows}, {columns})") } else { format!("({planes}, {rows}, {columns})") }
    }

    /// Returns whether all numbers are within a content of so many bytes.
    pub(super) fn is_within(&self, bytes: usize) -> bool {
        if self.shape.contains(&0) {
            return true;
        }
        let last = self.shape.iter().zip(&self.strides).try_fold(0_usize, |last, (side, stride)| {
            (side - 1).checked_mul(*stride).and_then(|by| last.checked_add(by))
        });
        let end =
            last.and_then(|last| last.checked_add(1)?.checked_mul(self.dtype.size)?.checked_add(self.start));
        end.is_some_and(|end| end <= bytes)
    }
}

/// Returns the distances between neighbours in an array without gaps, in numbers.
pub(super) fn strides_of(sides: &[usize], by_column: bool) -> Vec<usize> {
    let mut strides = vec![1_usize; sides.len()];
    for i in 1..sides.len() {
        let (here, inner) = if by_column { (i, i - 1) } else { (sides.len() - 1 - i, sides.len() - i) };
        strides[here] = strides[inner].saturating_mul(sides[inner]);
    }
    strides
}

/// Returns the shape and the strides of an array of any number of dimensions as planes, rows and columns;
/// `None` if its planes are not at equal distances, or if there are not as many strides as sides.
pub(super) fn folded(sides: &[usize], strides: &[usize]) -> Option<([usize; 3], [usize; 3])> {
    if sides.len() != strides.len() {
        return None;
    }
    let (mut planes, mut distance) = (1_usize, 0);
    let outer = sides.len().saturating_sub(2);
    for (side, stride) in sides[..outer].iter().zip(strides) {
        if planes == 1 {
            (planes, distance) = (*side, *stride);
        } else if *side != 1 {
            if distance != stride.checked_mul(*side)? {
                return None;
            }
            (planes, distance) = (planes.checked_mul(*side)?, *stride);
        }
    }
    Some(match (&sides[outer..], &strides[outer..]) {
        ([rows, columns], [down, across]) => ([planes, *rows, *columns], [distance, *down, *across]),
        ([rows], [down]) => ([1, *rows, 1], [0, *down, 0]),
        _ => ([1, 1, 1], [0, 0, 0]),
    })
}

/// Numbers in rows and columns.
pub(crate) struct Grid<'a> {
    pub rows: usize,
    pub columns: usize,
    pub(super) numbers: Numbers<'a>,
}

/// Numbers of a grid.
pub(super) enum Numbers<'a> {
    Raw { bytes: &'a [u8], dtype: Dtype, start: usize, strides: [usize; 2] },
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
            Numbers::Raw { bytes, dtype, start, strides } => {
                let at = start + (row * strides[0] + column * strides[1]) * dtype.size;
                bytes.get(at..at + dtype.size).map_or(f64::NAN, |b| dtype.number(b))
            }
        }
    }
}
