//! Errors of reading and writing files.

use std::fmt::{self, Write};
use std::io;
use std::path::{Path, PathBuf};

use reactsim_scene::{SceneError, brief};

use super::wire::WireError;

/// Error of reading or writing a file, or one record of it.
#[derive(Debug)]
pub struct FormatError {
    /// The file or folder.
    pub path: PathBuf,
    /// Index of the record in the file, from 0, if the error concerns one.
    pub record: Option<u64>,
    /// Id of the scenario, if known.
    pub scenario: Option<String>,
    /// Cause of the error.
    pub cause: Box<Cause>,
    ends_file: bool,
}

/// Cause of an error in a file or a record.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Cause {
    /// The operating system reported an error.
    #[error("could not {doing}: {source}")]
    Io {
        /// The attempted operation, such as `read` or `write`.
        doing: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
    /// No format recognises the file.
    #[error("is {found}, not a scenario file; known formats: {known}")]
    Unrecognised {
        /// Description of the content.
        found: &'static str,
        /// The known formats.
        known: String,
    },
    /// The format cannot be read from URLs.
    #[error(
        "is of the format {format}, which is read from several files of a file system: copy the data set to one"
    )]
    LocalOnly {
        /// Id of the format.
        format: &'static str,
    },
    /// A folder holds no scenario file.
    #[error("holds no scenario file; known formats: {known}")]
    NoInput {
        /// The known formats.
        known: String,
    },
    /// The file ends inside a record.
    #[error("is truncated: {what} has {found} of {expected} bytes")]
    Truncated {
        /// The part of the record.
        what: &'static str,
        /// Bytes found.
        found: u64,
        /// Bytes expected.
        expected: u64,
    },
    /// A checksum does not match.
    #[error("is damaged: the checksum of {what} is {found}, expected {expected}; fetch the file again")]
    Checksum {
        /// The data covered by the checksum.
        what: &'static str,
        /// The checksum of the data read.
        found: String,
        /// The checksum stored in the file.
        expected: String,
    },
    /// The content cannot be decoded.
    #[error("cannot be decoded: {0}")]
    Undecodable(String),
    /// The file holds another kind of content, another version or other columns.
    #[error("{what} is {found}, expected {expected}")]
    Schema {
        /// Column or key.
        what: String,
        /// The value found.
        found: String,
        /// The expected value.
        expected: String,
    },
    /// A field has an invalid value.
    #[error("{field} is {value}, expected {expected}")]
    Value {
        /// Path of the field.
        field: String,
        /// The value found.
        value: String,
        /// The expected value.
        expected: String,
    },
    /// The decoded parts do not form a valid scenario.
    #[error("{} is {}, expected {}", .0.field, .0.value, .0.expected)]
    Scene(SceneError),
}

impl Cause {
    /// A field has an invalid value; long values are abbreviated.
    pub fn value(field: impl Into<String>, value: impl fmt::Display, expected: impl Into<String>) -> Self {
        Self::Value {
            field: field.into(),
            value: brief(&value.to_string()).into_owned(),
            expected: expected.into(),
        }
    }

    /// The structure of a file is not the expected one.
    pub fn schema(what: impl Into<String>, found: impl fmt::Display, expected: impl Into<String>) -> Self {
        Self::Schema { what: what.into(), found: found.to_string(), expected: expected.into() }
    }

    /// A file cannot be read.
    pub fn read(source: io::Error) -> Self {
        Self::Io { doing: "read", source }
    }

    /// A file cannot be written.
    pub fn write(source: io::Error) -> Self {
        Self::Io { doing: "write", source }
    }
}

impl From<WireError> for Cause {
    fn from(error: WireError) -> Self {
        Self::Undecodable(error.to_string())
    }
}

impl FormatError {
    /// Returns an error after which nothing more of the file can be read.
    pub fn file(path: &Path, cause: Cause) -> Self {
        Self { path: path.to_owned(), record: None, scenario: None, cause: Box::new(cause), ends_file: true }
    }

    /// Returns an error of one record; reading continues with the next.
    pub fn record(path: &Path, record: u64, scenario: Option<String>, cause: Cause) -> Self {
        Self {
            path: path.to_owned(),
            record: Some(record),
            scenario,
            cause: Box::new(cause),
            ends_file: false,
        }
    }

    /// Returns the same error with a record index.
    pub(crate) fn at(self, record: u64) -> Self {
        Self { record: Some(record), ..self }
    }

    /// Returns the error of parts that do not form a valid scenario.
    pub(crate) fn scene(path: &Path, record: u64, error: SceneError) -> Self {
        let scenario = Some(error.scenario.clone()).filter(|id| !id.is_empty());
        Self::record(path, record, scenario, Cause::Scene(error))
    }

    /// Returns whether reading of the file ends here. Otherwise the error concerns one record, and the next
    /// record may be valid.
    pub fn ends_file(&self) -> bool {
        self.ends_file
    }
}

impl fmt::Display for FormatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut line = SanitizedLine { to: f, left: MAX_MESSAGE_LENGTH };
        write!(line, "{}", self.path.display())?;
        if let Some(record) = self.record {
            write!(line, ": record {record}")?;
        }
        if let Some(scenario) = &self.scenario {
            write!(line, ": scenario `{scenario}`")?;
        }
        write!(line, ": {}", self.cause)
    }
}

/// Maximum length of a message in characters: quoted content may be as long as the file.
const MAX_MESSAGE_LENGTH: usize = 4000;

/// Writer that makes file content safe to print on one line: it escapes characters that control a terminal
/// and truncates long text.
struct SanitizedLine<'a, 'b> {
    to: &'a mut fmt::Formatter<'b>,
    left: usize,
}

impl Write for SanitizedLine<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for c in text.chars().take(self.left) {
            // In addition to control characters: line separators and text direction marks.
            if c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}') {
                write!(self.to, "{}", c.escape_unicode())?;
            } else {
                self.to.write_char(c)?;
            }
            self.left -= 1;
            if self.left == 0 {
                self.to.write_str(" …")?;
            }
        }
        Ok(())
    }
}

impl std::error::Error for FormatError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        std::error::Error::source(self.cause.as_ref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_line_without_control_characters() {
        let cause = Cause::value("`a\n`", "\u{1b}[2J\u{202e}ö`", "a \"name\"");
        let error = FormatError::record(Path::new("a\tb"), 3, Some("\u{9b}31m".into()), cause);
        assert_eq!(
            error.to_string(),
            "a\\u{9}b: record 3: scenario `\\u{9b}31m`: `a\\u{a}` is \\u{1b}[2J\\u{202e}ö`, expected a \"name\""
        );
        let long = FormatError::file(Path::new("a"), Cause::Undecodable("ä".repeat(1_000_000)));
        assert!(
            long.to_string().ends_with("ää …") && long.to_string().chars().count() == MAX_MESSAGE_LENGTH + 2
        );
    }
}
