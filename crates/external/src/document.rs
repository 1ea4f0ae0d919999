//! The content of a frame: tensors and texts by name, as a safetensors document behind its length.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::fmt::Display;
use std::io::{self, Read};

use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorInfo};

/// A reason why a document is refused; the text names the field.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct DocumentError(pub String);

/// Largest header of a document that is written, bytes: the Python package reads no larger ones. Contents
/// that grow with scenarios, agents or events are tensors ([`Values::bytes`]), not texts.
const MAX_HEADER: usize = 64 << 20;

/// A document that is being written.
#[derive(Clone, Debug, Default)]
pub struct FrameWriter {
    texts: HashMap<String, String>,
    tensors: BTreeMap<&'static str, Values>,
}

/// A tensor of a document: numbers in row-major order with their shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Values {
    fn of<const N: usize>(dtype: Dtype, shape: &[usize], numbers: impl Iterator<Item = [u8; N]>) -> Self {
        Self { dtype, shape: shape.to_vec(), bytes: numbers.collect::<Vec<_>>().into_flattened() }
    }

    /// Creates a tensor of `f64`.
    pub fn f64(shape: &[usize], numbers: impl IntoIterator<Item = f64>) -> Self {
        Self::of(Dtype::F64, shape, numbers.into_iter().map(f64::to_le_bytes))
    }

    /// Creates a tensor of `f32`, given as little-endian bytes, which are not copied.
    pub fn f32(shape: &[usize], numbers: Vec<[u8; 4]>) -> Self {
        Self { dtype: Dtype::F32, shape: shape.to_vec(), bytes: numbers.into_flattened() }
    }

    /// Creates a tensor of `i32`.
    pub fn i32(shape: &[usize], numbers: impl IntoIterator<Item = i32>) -> Self {
        Self::of(Dtype::I32, shape, numbers.into_iter().map(i32::to_le_bytes))
    }

    /// Creates a tensor of `i64`.
    pub fn i64(shape: &[usize], numbers: impl IntoIterator<Item = i64>) -> Self {
        Self::of(Dtype::I64, shape, numbers.into_iter().map(i64::to_le_bytes))
    }

    /// Creates a tensor of `u64`.
    pub fn u64(shape: &[usize], numbers: impl IntoIterator<Item = u64>) -> Self {
        Self::of(Dtype::U64, shape, numbers.into_iter().map(u64::to_le_bytes))
    }

    /// Creates a tensor of `u8`.
    pub fn u8(shape: &[usize], numbers: impl IntoIterator<Item = u8>) -> Self {
        Self::of(Dtype::U8, shape, numbers.into_iter().map(|n| [n]))
    }

    /// Creates a tensor of `u8` from bytes, such as a text of any length.
    pub fn bytes(bytes: Vec<u8>) -> Self {
        Self { dtype: Dtype::U8, shape: vec![bytes.len()], bytes }
    }
}

impl FrameWriter {
    /// Begins a document of a message type.
    pub fn new(kind: &str) -> Self {
        let mut document = Self::default();
        document.text("type", kind).text("protocol", super::PROTOCOL);
        document
    }

    /// Sets a text.
    pub fn text(&mut self, key: &str, value: impl Into<String>) -> &mut Self {
        self.texts.insert(key.to_owned(), value.into());
        self
    }

    /// Sets a tensor.
    pub fn tensor(&mut self, name: &'static str, values: Values) -> &mut Self {
        debug_assert_eq!(
            values.shape.iter().product::<usize>() * values.dtype.bitsize() / 8,
            values.bytes.len(),
            "{name}"
        );
        self.tensors.insert(name, values);
        self
    }

    /// Returns the frame: the length, `u64` little-endian, and the document.
    ///
    /// # Errors
    /// If the names and texts are larger than a reader accepts.
    pub fn to_frame(&self) -> Result<Vec<u8>, DocumentError> {
        let texts: usize = self.texts.iter().map(|(key, text)| key.len() + text.len()).sum();
        if texts > MAX_HEADER {
            return Err(DocumentError(format!(
                "names and texts have {texts} bytes, expected at most {MAX_HEADER}: shorten the ids of \
                 scenarios and agents"
            )));
        }
        // Wide types first, so that every tensor is aligned.
        let mut tensors: Vec<(&str, &Values)> =
            self.tensors.iter().map(|(name, values)| (*name, values)).collect();
        tensors.sort_by_key(|(_, values)| Reverse(values.dtype));
        let mut size = 0;
        let info = |&(name, Values { dtype, shape, bytes }): &(&str, &Values)| {
            let data_offsets = (size, size + bytes.len());
            size = data_offsets.1;
            (name.to_owned(), TensorInfo { dtype: *dtype, shape: shape.clone(), data_offsets })
        };
        let infos = tensors.iter().map(info).collect();
        let failed = |error: &dyn Display| DocumentError(format!("the frame cannot be written: {error}"));
        let header = Metadata::new(Some(self.texts.clone()), infos).map_err(|error| failed(&error))?;
        let mut header = serde_json::to_vec(&header).map_err(|error| failed(&error))?;
        header.resize(header.len().next_multiple_of(size_of::<u64>()), b' ');
        let length = size_of::<u64>() + header.len() + size;
        let mut frame = Vec::with_capacity(size_of::<u64>() + length);
        frame.extend_from_slice(&(length as u64).to_le_bytes());
        frame.extend_from_slice(&(header.len() as u64).to_le_bytes());
        frame.extend_from_slice(&header);
        tensors.iter().for_each(|(_, values)| frame.extend_from_slice(&values.bytes));
        Ok(frame)
    }
}

/// Reads the bytes of one frame, without its length. `Ok(None)` at the end of the stream. `most` is asked
/// when the length is known: a frame may be awaited before it is clear how long it can be.
///
/// # Errors
/// If the stream ends inside a frame, or the frame has more than `most` bytes.
pub fn read_frame(from: &mut dyn Read, most: impl Fn() -> u64) -> io::Result<Option<Vec<u8>>> {
    let mut length = Vec::new();
    Read::take(&mut *from, 8).read_to_end(&mut length)?;
    let length = match length.try_into() {
        Ok(length) => u64::from_le_bytes(length),
        Err(length) if length.is_empty() => return Ok(None),
        Err(_) => return Err(io::Error::other("the output ends inside the length of a frame")),
    };
    let most = most();
    if length > most {
        let text = if length.to_le_bytes().iter().all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()) {
            let start = String::from_utf8_lossy(&length.to_le_bytes()).into_owned();
            format!(
                "the output begins with the text {start:?}: only frames may be written to standard output"
            )
        } else {
            format!("a frame of {length} bytes was announced; at most {most} are possible here")
        };
        return Err(io::Error::other(text));
    }
    let mut bytes = Vec::new();
    from.take(length).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != length {
        let text = format!("the output ends after {} of {length} bytes of a frame", bytes.len());
        return Err(io::Error::other(text));
    }
    Ok(Some(bytes))
}

/// A document that was received.
pub struct Frame {
    bytes: Vec<u8>,
    header: Metadata,
    /// Offset of the tensors.
    data: usize,
}

impl Frame {
    /// Reads a document.
    ///
    /// # Errors
    /// [`DocumentError`] if it is not safetensors, has no `type`, or is of another version of the protocol.
    pub fn read(bytes: Vec<u8>) -> Result<Self, DocumentError> {
        let header = SafeTensors::read_metadata(&bytes);
        let (length, header) =
            header.map_err(|e| DocumentError(format!("the frame is not a safetensors document: {e}")))?;
        let frame = Self { bytes, header, data: size_of::<u64>() + length };
        let found = frame.text("protocol")?;
        if found != super::PROTOCOL {
            let own = super::PROTOCOL;
            return Err(DocumentError(format!(
                "the frame is of version {found:?} of the protocol; this program speaks {own}"
            )));
        }
        frame.text("type")?;
        Ok(frame)
    }

    /// Returns a text.
    ///
    /// # Errors
    /// [`DocumentError`] if it is missing.
    pub fn text(&self, key: &str) -> Result<&str, DocumentError> {
        let missing = || DocumentError(format!("the metadata has no `{key}`"));
        self.optional_text(key).ok_or_else(missing)
    }

    /// Returns a text that may be missing.
    pub fn optional_text(&self, key: &str) -> Option<&str> {
        self.header.metadata().as_ref()?.get(key).map(String::as_str)
    }

    /// Returns the shape of a tensor.
    ///
    /// # Errors
    /// [`DocumentError`] if it is missing.
    pub fn shape(&self, name: &str) -> Result<&[usize], DocumentError> {
        Ok(&self.tensor(name)?.0.shape)
    }

    /// Returns the numbers of a tensor of `f64` or `f32` with this shape.
    ///
    /// # Errors
    /// [`DocumentError`] naming the tensor with the expected and the found type or shape.
    pub fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f64>, DocumentError> {
        let (tensor, data) = self.tensor(name)?;
        if tensor.shape != shape {
            let found = &tensor.shape;
            return Err(DocumentError(format!("`{name}` has the shape {found:?} instead of {shape:?}")));
        }
        match tensor.dtype {
            Dtype::F64 => Ok(numbers(data, f64::from_le_bytes)),
            Dtype::F32 => Ok(numbers(data, |b| f64::from(f32::from_le_bytes(b)))),
            other => Err(DocumentError(format!("`{name}` has the type {other:?} instead of F64 or F32"))),
        }
    }

    /// Returns the bytes of a tensor of `u8`.
    ///
    /// # Errors
    /// [`DocumentError`] naming the tensor with the expected and the found type.
    pub fn bytes(&self, name: &str) -> Result<&[u8], DocumentError> {
        match self.tensor(name)? {
            (TensorInfo { dtype: Dtype::U8, .. }, data) => Ok(data),
            (TensorInfo { dtype, .. }, _) => {
                Err(DocumentError(format!("`{name}` has the type {dtype:?} instead of U8")))
            }
        }
    }

    fn tensor(&self, name: &str) -> Result<(&TensorInfo, &[u8]), DocumentError> {
        let missing = || DocumentError(format!("there is no tensor `{name}`"));
        let tensor = self.header.info(name).ok_or_else(missing)?;
        // Reading the header has checked that the offsets fit type, shape and bytes.
        Ok((tensor, &self.bytes[self.data + tensor.data_offsets.0..self.data + tensor.data_offsets.1]))
    }
}

fn numbers<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
    bytes.as_chunks::<N>().0.iter().map(|chunk| number(*chunk)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written() -> Vec<u8> {
        let mut document = FrameWriter::new("planned");
        document.text("seq", "3");
        document.tensor("states", Values::f64(&[1, 2], [0.1, f64::MIN_POSITIVE]));
        document.tensor("kind", Values::u8(&[3], [1, 2, 255]));
        document.to_frame().unwrap()
    }

    #[test]
    fn what_is_written_is_read() {
        let bytes = written();
        let document = read_frame(&mut bytes.as_slice(), || 1 << 20).unwrap().unwrap();
        let frame = Frame::read(document).unwrap();
        assert_eq!(frame.text("type").unwrap(), "planned");
        assert_eq!(frame.floats("states", &[1, 2]).unwrap(), [0.1, f64::MIN_POSITIVE]);
        let text = |shape: &[usize], name| frame.floats(name, shape).unwrap_err().0;
        assert_eq!(text(&[2, 1], "states"), "`states` has the shape [1, 2] instead of [2, 1]");
        assert_eq!(text(&[3], "kind"), "`kind` has the type U8 instead of F64 or F32");
        assert_eq!(text(&[3], "x"), "there is no tensor `x`");
        assert_eq!(frame.text("error").unwrap_err().0, "the metadata has no `error`");
    }

    #[test]
    fn texts_that_no_reader_accepts_are_refused() {
        let mut document = FrameWriter::new("begin");
        document.text("agent_ids", "a".repeat(MAX_HEADER + 1));
        assert!(document.to_frame().unwrap_err().0.contains("shorten the ids"));
        let long = vec![7; 1000];
        document.text("agent_ids", "").tensor("document", Values::bytes(long.clone()));
        let frame = document.to_frame().unwrap();
        assert_eq!(Frame::read(frame[8..].to_vec()).unwrap().bytes("document").unwrap(), long);
    }

    #[test]
    fn broken_streams_are_told_from_their_end() {
        let bytes = written();
        let read = |bytes: &[u8], most| read_frame(&mut &*bytes, || most).map_err(|e| e.to_string());
        assert_eq!(read(&[], 10), Ok(None));
        assert!(read(&bytes[..5], 1 << 20).unwrap_err().contains("inside the length"));
        assert!(read(&bytes[..50], 1 << 20).unwrap_err().contains("ends after 42 of"));
        assert!(read(&bytes, 9).unwrap_err().contains("at most 9 are possible"));
        let printed = read(b"Loading weights ...\n", 1 << 20).unwrap_err();
        assert!(printed.contains("begins with the text \"Loading \""), "{printed}");
    }

    #[test]
    fn changed_bytes_are_refused_or_read() {
        let bytes = written();
        for at in 8..bytes.len() {
            for change in [1, 0x20, 0x80, 0xff] {
                let mut changed = bytes[8..].to_vec();
                changed[at - 8] ^= change;
                // No panic, whatever the document holds.
                if let Ok(frame) = Frame::read(changed) {
                    let _ = frame.floats("states", &[1, 2]);
                }
            }
        }
    }
}
