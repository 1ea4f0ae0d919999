//! The wire format of Protocol Buffers (<https://protobuf.dev/programming-guides/encoding/>). Messages are
//! read where they lie, field by field, and written to a list of bytes.
//!
//! For a field that occurs more than once, the last number counts; texts and numbers of lists follow one
//! another, and messages are merged. Numbers of lists may be packed into one field. Fields that a reader does
//! not know are passed over. Groups, which were abandoned before these messages were defined, are refused.

/// Ways in which the content of a field is stored.
const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const BYTES: u8 = 2;
const FIXED_32: u8 = 5;
/// Maximum length of a number of variable length in bytes.
const MAX_VARINT_LENGTH: usize = 10;

/// Why a message is malformed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// A number or a field is longer than what is left of the message.
    #[error("a field is cut off")]
    CutOff,
    /// A number has more than 64 bits.
    #[error("a number has more than 64 bits")]
    LongNumber,
    /// A key has no valid tag.
    #[error("a field has an invalid tag")]
    Tag,
    /// The content of a field is stored in another way than its definition says, or in one that no longer
    /// exists.
    #[error("field {tag} has the wire type {kind}")]
    Kind {
        /// Tag of the field.
        tag: u32,
        /// The wire type.
        kind: u8,
    },
    /// A text is not UTF-8.
    #[error("a text is not UTF-8")]
    Text,
}

/// Beginning of a field: its tag, and the way in which its content is stored.
#[derive(Clone, Copy)]
pub struct Key(u32);

impl Key {
    /// Returns the tag of the field.
    pub fn tag(self) -> u32 {
        self.0 >> 3
    }

    fn kind(self) -> u8 {
        (self.0 & 7) as u8
    }

    fn expect(self, kind: u8) -> Result<(), WireError> {
        if self.kind() == kind { Ok(()) } else { Err(self.refused()) }
    }

    fn refused(self) -> WireError {
        WireError::Kind { tag: self.tag(), kind: self.kind() }
    }
}

/// Reader of the fields of a message. After each [`Fields::key`], the content of the field is read, or passed
/// over by [`Fields::skip`]. All methods fail for malformed fields.
pub struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    /// Begins to read a message.
    pub fn new(message: &'a [u8]) -> Self {
        Self(message)
    }

    /// Returns the number of bytes that are not read yet.
    pub fn left(&self) -> usize {
        self.0.len()
    }

    /// Reads the key of the next field; `None` at the end of the message.
    pub fn key(&mut self) -> Result<Option<Key>, WireError> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let key = u32::try_from(self.varint()?).ok().map(Key);
        key.filter(|key| key.tag() > 0).map(Some).ok_or(WireError::Tag)
    }

    /// Reads the key of the next field and its content, which is empty for numbers; `None` at the end of the
    /// message.
    pub fn next_content(&mut self) -> Result<Option<(u32, &'a [u8])>, WireError> {
        let Some(key) = self.key()? else { return Ok(None) };
        Ok(Some((key.tag(), self.skip(key)?)))
    }

    /// Passes over a field and returns its content, which is empty for numbers.
    pub fn skip(&mut self, key: Key) -> Result<&'a [u8], WireError> {
        match key.kind() {
            VARINT => drop(self.varint()?),
            FIXED_64 => drop(self.array::<8>()?),
            FIXED_32 => drop(self.array::<4>()?),
            BYTES => return self.bytes(key),
            _ => return Err(key.refused()),
        }
        Ok(&[])
    }

    /// Reads a `double`.
    pub fn double(&mut self, key: Key) -> Result<f64, WireError> {
        key.expect(FIXED_64)?;
        self.array().map(f64::from_le_bytes)
    }

    /// Reads a `float`.
    pub fn float(&mut self, key: Key) -> Result<f32, WireError> {
        key.expect(FIXED_32)?;
        self.array().map(f32::from_le_bytes)
    }

    /// Reads an `int64`.
    pub fn int64(&mut self, key: Key) -> Result<i64, WireError> {
        key.expect(VARINT)?;
        Ok(self.varint()? as i64)
    }

    /// Reads an `int32` or an `enum`.
    pub fn int32(&mut self, key: Key) -> Result<i32, WireError> {
        Ok(self.int64(key)? as i32)
    }

    /// Reads a `bool`.
    pub fn flag(&mut self, key: Key) -> Result<bool, WireError> {
        Ok(self.int64(key)? != 0)
    }

    /// Reads a message or any other content of bytes.
    pub fn bytes(&mut self, key: Key) -> Result<&'a [u8], WireError> {
        key.expect(BYTES)?;
        let length = usize::try_from(self.varint()?).map_err(|_| WireError::CutOff)?;
        let (content, rest) = self.0.split_at_checked(length).ok_or(WireError::CutOff)?;
        self.0 = rest;
        Ok(content)
    }

    /// Reads a `string`.
    pub fn text(&mut self, key: Key) -> Result<&'a str, WireError> {
        str::from_utf8(self.bytes(key)?).map_err(|_| WireError::Text)
    }

    /// Appends a `double` of a list, or several that are packed.
    pub fn doubles(&mut self, key: Key, list: &mut Vec<f64>) -> Result<(), WireError> {
        if key.kind() == BYTES {
            return extend(list, self.bytes(key)?, f64::from_le_bytes);
        }
        list.push(self.double(key)?);
        Ok(())
    }

    /// Appends a `float` of a list, or several that are packed.
    pub fn floats(&mut self, key: Key, list: &mut Vec<f32>) -> Result<(), WireError> {
        if key.kind() == BYTES {
            return extend(list, self.bytes(key)?, f32::from_le_bytes);
        }
        list.push(self.float(key)?);
        Ok(())
    }

    /// Returns the numbers of variable length of a list: one, or several that are packed.
    pub fn int64s(&mut self, key: Key) -> Result<Int64s<'a>, WireError> {
        if key.kind() == BYTES {
            return self.bytes(key).map(|packed| Int64s(Fields(packed)));
        }
        let before = self.0;
        self.int64(key)?;
        Ok(Int64s(Fields(&before[..before.len() - self.0.len()])))
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], WireError> {
        let (array, rest) = self.0.split_first_chunk().ok_or(WireError::CutOff)?;
        self.0 = rest;
        Ok(*array)
    }

    fn varint(&mut self) -> Result<u64, WireError> {
        match self.0 {
            [byte, rest @ ..] if *byte < 0x80 => {
                self.0 = rest;
                Ok(u64::from(*byte))
            }
            _ => self.long_varint(),
        }
    }

    /// Reads a number of more than one byte.
    fn long_varint(&mut self) -> Result<u64, WireError> {
        let mut value = 0;
        for (i, byte) in self.0.iter().take(MAX_VARINT_LENGTH).enumerate() {
            value |= u64::from(byte & 0x7f) << (7 * i);
            if *byte < 0x80 {
                self.0 = &self.0[i + 1..];
                // Nine bytes have 63 bits.
                let is_long = i + 1 == MAX_VARINT_LENGTH && *byte > 1;
                return if is_long { Err(WireError::LongNumber) } else { Ok(value) };
            }
        }
        Err(if self.0.len() < MAX_VARINT_LENGTH { WireError::CutOff } else { WireError::LongNumber })
    }
}

/// Numbers of variable length, one after another.
pub struct Int64s<'a>(Fields<'a>);

impl Int64s<'_> {
    /// Returns the largest number of numbers that these can be.
    pub fn most(&self) -> usize {
        self.0.left()
    }
}

impl Iterator for Int64s<'_> {
    type Item = Result<i64, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.0.is_empty() {
            return None;
        }
        let number = self.0.varint();
        if number.is_err() {
            self.0 = Fields(&[]);
        }
        Some(number.map(|number| number as i64))
    }
}

/// Appends packed numbers of `N` bytes each.
fn extend<T, const N: usize>(
    list: &mut Vec<T>,
    packed: &[u8],
    number: fn([u8; N]) -> T,
) -> Result<(), WireError> {
    let (numbers, rest) = packed.as_chunks::<N>();
    list.extend(numbers.iter().copied().map(number));
    if rest.is_empty() { Ok(()) } else { Err(WireError::CutOff) }
}

/// Writer of the fields of a message.
#[derive(Default)]
pub struct Message(Vec<u8>);

impl Message {
    /// Returns the encoded message.
    pub fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    /// Adds a number of variable length: an `int32`, an `int64`, a `bool` or an `enum`.
    pub fn int64(&mut self, tag: u32, number: i64) {
        self.key(tag, VARINT);
        put_varint(&mut self.0, number as u64);
    }

    /// Adds a `double`.
    pub fn double(&mut self, tag: u32, number: f64) {
        self.key(tag, FIXED_64);
        self.0.extend(number.to_le_bytes());
    }

    /// Adds a `float`.
    pub fn float(&mut self, tag: u32, number: f32) {
        self.key(tag, FIXED_32);
        self.0.extend(number.to_le_bytes());
    }

    /// Adds a `string` or any other content of bytes, such as a message.
    pub fn bytes(&mut self, tag: u32, content: impl AsRef<[u8]>) {
        let content = content.as_ref();
        self.key(tag, BYTES);
        put_varint(&mut self.0, content.len() as u64);
        self.0.extend_from_slice(content);
    }

    /// Adds packed `float`s, if there are any.
    pub fn floats(&mut self, tag: u32, numbers: &[f32]) {
        if !numbers.is_empty() {
            self.key(tag, BYTES);
            put_varint(&mut self.0, size_of_val(numbers) as u64);
            self.0.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        }
    }

    fn key(&mut self, tag: u32, kind: u8) {
        put_varint(&mut self.0, u64::from(tag) << 3 | u64::from(kind));
    }
}

/// Appends a number of variable length.
pub(crate) fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}
