//! Answers of the helper: a line `ID KIND LENGTH`, separated by tabs, and as many bytes.

use std::io::{self, BufRead, ErrorKind, Read};

/// First line of the helper.
pub(super) const GREETING: &str = "reactsim-store 1";
/// Maximum length of a line in bytes.
const MAX_LINE: u64 = 256;
/// Maximum length of a content in bytes: a list of some million files.
const MAX_CONTENT: u64 = 1 << 30;

/// Outcome of a request.
#[derive(Debug)]
pub(super) enum Answer {
    /// The content that was asked for.
    Content(Vec<u8>),
    /// The helper cannot read it.
    Failure(Failure),
    /// The helper ended, or its answers make no sense; the text says why.
    Lost(String),
    /// No answer came in time.
    Late,
}

/// Reason why a URL cannot be read.
#[derive(Clone, Debug)]
pub(super) struct Failure {
    pub(super) kind: ErrorKind,
    pub(super) text: String,
}

impl From<Failure> for io::Error {
    fn from(failure: Failure) -> Self {
        Self::new(failure.kind, failure.text)
    }
}

/// Reads an answer and the id of its request; `None` at the end of the stream.
///
/// # Errors
/// A text if the stream is none of this protocol.
pub(super) fn read(from: &mut impl BufRead) -> Result<Option<(u64, Answer)>, String> {
    let Some(line) = line(from)? else { return Ok(None) };
    let strange = || format!("it answers `{}`, which is not of its protocol", line.escape_debug());
    let mut parts = line.split('\t');
    let (Some(id), Some(kind), Some(length), None) = (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(strange());
    };
    let (Ok(id), Ok(length)) = (id.parse::<u64>(), length.parse::<u64>()) else { return Err(strange()) };
    let kind = match kind {
        "ok" => None,
        "missing" => Some(ErrorKind::NotFound),
        "forbidden" => Some(ErrorKind::PermissionDenied),
        "changed" => Some(ErrorKind::InvalidData),
        "unsupported" => Some(ErrorKind::Unsupported),
        "failed" => Some(ErrorKind::Other),
        _ => return Err(strange()),
    };
    if length > MAX_CONTENT {
        return Err(strange());
    }
    // The buffer grows as bytes arrive, so that a wrong length allocates nothing.
    let mut content = Vec::new();
    let found = from.take(length).read_to_end(&mut content).map_err(|e| e.to_string())?;
    if (found as u64) < length {
        return Ok(None);
    }
    Ok(Some((
        id,
        match kind {
            None => Answer::Content(content),
            Some(kind) => {
                Answer::Failure(Failure { kind, text: String::from_utf8_lossy(&content).into_owned() })
            }
        },
    )))
}

/// Reads a line without its end; `None` at the end of the stream.
///
/// # Errors
/// A text if it is too long.
pub(super) fn line(from: &mut impl BufRead) -> Result<Option<String>, String> {
    let mut line = Vec::new();
    from.take(MAX_LINE).read_until(b'\n', &mut line).map_err(|e| e.to_string())?;
    match line.pop() {
        None => Ok(None),
        Some(b'\n') => Ok(Some(String::from_utf8_lossy(&line).into_owned())),
        Some(last) if (line.len() as u64) < MAX_LINE - 1 => {
            line.push(last);
            Err(format!("it ends with `{}`", String::from_utf8_lossy(&line).escape_debug()))
        }
        Some(_) => {
            let begin = String::from_utf8_lossy(&line[..32]).into_owned();
            Err(format!("it answers `{}…`, which is not of its protocol", begin.escape_debug()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_follow_one_another() {
        let mut stream = &b"3\tok\t2\na\n4\tmissing\t4\ngone5\tok\t9\nshort"[..];
        assert!(matches!(read(&mut stream), Ok(Some((3, Answer::Content(c)))) if c == b"a\n"));
        let Ok(Some((4, Answer::Failure(failure)))) = read(&mut stream) else { panic!() };
        assert_eq!((failure.kind, failure.text.as_str()), (ErrorKind::NotFound, "gone"));
        assert!(matches!(read(&mut stream), Ok(None)), "the stream ends in an answer");
    }

    #[test]
    fn other_streams_are_refused() {
        let long = vec![b'x'; 1000];
        for stream in [
            &b"hello\n"[..],
            b"1\tok\n",
            b"1\tok\t2\t3\n",
            b"x\tok\t2\n",
            b"1\tfine\t0\n",
            b"1\tok\t-1\n",
            b"1\tok\t99999999999999\n",
            b"\xff\xfe\n",
            b"unfinished",
            &long,
        ] {
            let text = read(&mut &stream[..]).unwrap_err();
            assert!(text.contains('`') && text.len() < 400, "{text}");
        }
    }
}
