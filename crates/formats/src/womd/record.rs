//! TFRecord framing: u64 length, u32 masked CRC-32C of the length, payload, u32 masked CRC-32C of the
//! payload, little-endian.

use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use flate2::bufread::GzDecoder;
use reactsim_files::{as_url, open_regular};

use super::example::is_example;
use crate::error::{Cause, FormatError};
use crate::format::{GZIP, ZSTD, head};

/// Maximum length of a record in bytes: a scenario has a few megabytes, and compressed files can claim much
/// more than they contain.
pub(crate) const MAX_RECORD_LENGTH: u64 = 1 << 27;
/// Length in bytes that few records exceed.
const USUAL_LENGTH: u64 = 1 << 22;
/// Maximum window size of zstd files, as a power of two: files of long records need large windows.
const MAX_WINDOW_LOG: u32 = 27;
/// Size of the read buffer in bytes.
const BUFFER_SIZE: usize = 1 << 16;
/// Size of a record header (length and its checksum) in bytes.
const HEADER_SIZE: usize = 12;

/// Reader of the records of a file, one at a time.
pub(crate) struct Records {
    path: PathBuf,
    source: Box<dyn Read + Send>,
    payload: Vec<u8>,
    /// Header of the next record, if it was found behind a damaged one.
    header: Option<[u8; HEADER_SIZE]>,
    next: u64,
    ended: bool,
}

impl Records {
    pub(crate) fn open(path: &Path) -> Result<Self, FormatError> {
        let source = source(path).map_err(|e| FormatError::file(path, Cause::read(e)))?;
        Ok(Self { path: path.to_owned(), source, payload: Vec::new(), header: None, next: 0, ended: false })
    }

    /// Returns whether a file begins with the header of a record.
    pub(crate) fn starts(path: &Path) -> bool {
        let mut header = [0; HEADER_SIZE];
        let read = source(path).and_then(|mut s| s.read_exact(&mut header));
        read.is_ok() && length(&header).is_ok()
    }

    /// Returns the checked payload of the next record; `None` at the end and after an error that ends the
    /// file.
    pub(crate) fn next(&mut self) -> Option<Result<&[u8], FormatError>> {
        if self.ended {
            return None;
        }
        let record = self.next;
        self.next += 1;
        match self.advance() {
            Ok(true) if is_example(&self.payload) => {
                self.ended = true;
                let expected = "records with `Scenario` messages: take the files of the data set's folder \
                                `scenario`, such as training.tfrecord-00000-of-01000";
                let cause = Cause::value("the content", "tf.Example records", expected);
                Some(Err(FormatError::file(&self.path, cause).at(record)))
            }
            Ok(true) => Some(Ok(&self.payload)),
            Ok(false) => {
                self.ended = true;
                // An empty file is a failed copy, not a data set of zero scenarios.
                let cause =
                    || Cause::Truncated { what: "the first record", found: 0, expected: HEADER_SIZE as u64 };
                (record == 0).then(|| Err(FormatError::file(&self.path, cause()).at(0)))
            }
            // If only the payload is damaged, the framing is intact and the next record can be read.
            Err(cause @ Cause::Checksum { what: "the record", .. }) => {
                Some(Err(FormatError::record(&self.path, record, None, cause)))
            }
            Err(cause) => {
                let is_header = matches!(cause, Cause::Checksum { .. });
                self.header = if is_header { self.find_header() } else { None };
                self.ended = self.header.is_none();
                Some(Err(FormatError::file(&self.path, cause).at(record)))
            }
        }
    }

    /// Like [`Self::next`], but gives the payload away.
    pub(crate) fn take_next(&mut self) -> Option<Result<Vec<u8>, FormatError>> {
        let checked = self.next()?.map(|_| ());
        Some(checked.map(|()| std::mem::take(&mut self.payload)))
    }

    /// Reads a record into `payload`; `false` at the end of the file.
    fn advance(&mut self) -> Result<bool, Cause> {
        let header = match self.header.take() {
            Some(header) => header,
            None => {
                match self.fill("the header of the record", HEADER_SIZE as u64) {
                    Err(Cause::Truncated { found: 0, .. }) => return Ok(false),
                    done => done?,
                }
                let mut header = [0; HEADER_SIZE];
                header.copy_from_slice(&self.payload);
                header
            }
        };
        let length = length(&header)?;
        if length > MAX_RECORD_LENGTH {
            return Err(Cause::value(
                "the length of the record",
                length,
                "at most 128 MiB; fetch the file again",
            ));
        }
        self.fill("the record", length + 4)?;
        let stated = self.payload.split_off(length as usize);
        check("the record", &self.payload, &stated)?;
        Ok(true)
    }

    /// Returns the next header behind a damaged one, which it reads to. Of bytes that are no header, one in
    /// four billion looks like one by its checksum.
    fn find_header(&mut self) -> Option<[u8; HEADER_SIZE]> {
        let mut window = [0; HEADER_SIZE];
        for read in 1..=MAX_RECORD_LENGTH {
            window.rotate_left(1);
            self.source.read_exact(&mut window[HEADER_SIZE - 1..]).ok()?;
            let is_whole = read >= HEADER_SIZE as u64;
            if is_whole && length(&window).is_ok_and(|length| (1..=MAX_RECORD_LENGTH).contains(&length)) {
                return Some(window);
            }
        }
        None
    }

    /// Reads `bytes` bytes. Beyond usual lengths, the buffer grows as they arrive: lengths may be wrong.
    fn fill(&mut self, what: &'static str, bytes: u64) -> Result<(), Cause> {
        self.payload.clear();
        self.payload.reserve(bytes.min(USUAL_LENGTH) as usize);
        let found =
            (&mut self.source).take(bytes).read_to_end(&mut self.payload).map_err(Cause::read)? as u64;
        if found < bytes { Err(Cause::Truncated { what, found, expected: bytes }) } else { Ok(()) }
    }
}

/// Returns the number of records of a file that is not compressed, by its headers alone; `None` for a
/// compressed or damaged file, and for a URL, of which every header would be a request.
pub(super) fn count(path: &Path) -> Option<usize> {
    if as_url(path).is_some() {
        return None;
    }
    let mut file = open_regular(path).ok()?;
    let bytes = file.size().ok()?;
    let (mut at, mut records) = (0, 0);
    while at < bytes {
        let mut header = [0; HEADER_SIZE];
        file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut header)).ok()?;
        at += HEADER_SIZE as u64 + length(&header).ok().filter(|length| *length <= MAX_RECORD_LENGTH)? + 4;
        records += 1;
    }
    Some(records)
}

/// Opens a file with the decompressor that its first bytes indicate.
pub(crate) fn source(path: &Path) -> std::io::Result<Box<dyn Read + Send>> {
    let first = head(path, ZSTD.len() as u64)?;
    let file = open_regular(path)?;
    Ok(if first.starts_with(ZSTD) {
        let mut decoder = zstd::stream::read::Decoder::new(file)?;
        decoder.window_log_max(MAX_WINDOW_LOG)?;
        Box::new(decoder)
    } else if first.starts_with(GZIP) {
        let members = GzipMembers { member: Some(GzDecoder::new(BufReader::new(file))) };
        Box::new(BufReader::with_capacity(BUFFER_SIZE, members))
    } else {
        Box::new(BufReader::with_capacity(BUFFER_SIZE, file))
    })
}

/// Reader of the members of a gzip file, one after another. Zeros after a member are padding, as for `gzip`:
/// files on tapes and in blocks end with it.
struct GzipMembers<R> {
    /// The current member; `None` at the end of the file.
    member: Option<GzDecoder<R>>,
}

impl<R: BufRead> Read for GzipMembers<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        while let Some(member) = &mut self.member {
            let read = member.read(buffer)?;
            if read > 0 || buffer.is_empty() {
                return Ok(read);
            }
            if let Some(mut rest) = self.member.take().map(GzDecoder::into_inner)
                && skip_zeros(&mut rest)?
            {
                self.member = Some(GzDecoder::new(rest));
            }
        }
        Ok(0)
    }
}

/// Passes over zeros. Returns whether another byte follows them.
fn skip_zeros(source: &mut impl BufRead) -> std::io::Result<bool> {
    loop {
        let bytes = source.fill_buf()?;
        let (length, zeros) = (bytes.len(), bytes.iter().take_while(|byte| **byte == 0).count());
        source.consume(zeros);
        if zeros < length || length == 0 {
            return Ok(length > 0);
        }
    }
}

fn length(header: &[u8; HEADER_SIZE]) -> Result<u64, Cause> {
    let (length, stated) = header.split_at(8);
    check("the length of the record", length, stated)?;
    let mut bytes = [0; 8];
    bytes.copy_from_slice(length);
    Ok(u64::from_le_bytes(bytes))
}

fn check(what: &'static str, data: &[u8], stated: &[u8]) -> Result<(), Cause> {
    let sum = masked_crc(data);
    if sum.to_le_bytes() == *stated {
        return Ok(());
    }
    let hex = |bytes: &[u8]| bytes.iter().rev().map(|b| format!("{b:02x}")).collect::<String>();
    Err(Cause::Checksum { what, found: hex(&sum.to_le_bytes()), expected: hex(stated) })
}

/// Returns a record of a TFRecord file with this payload.
pub fn tf_record(payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u64).to_le_bytes();
    let sums = [masked_crc(&length), masked_crc(payload)].map(u32::to_le_bytes);
    [&length[..], &sums[0], payload, &sums[1]].concat()
}

/// Returns the CRC-32C, rotated and offset as in TensorFlow (a plain checksum is weak for data that contain
/// checksums).
pub(super) fn masked_crc(data: &[u8]) -> u32 {
    crc32c::crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8)
}
