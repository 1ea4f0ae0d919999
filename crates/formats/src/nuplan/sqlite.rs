//! Read-only access to SQLite files by table and column. Errors name table, column and row.

use std::fmt::Write as _;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use reactsim_files::open_local;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row};

use super::token::Token;
use crate::error::{Cause, FormatError};

/// First bytes of every SQLite file.
const MAGIC: &[u8] = b"SQLite format 3\0";
/// Length of the header of a SQLite file in bytes.
const HEADER_LENGTH: usize = 100;
/// Number of SQLite virtual machine steps between checks of the step limit.
const STEPS_PER_CHECK: i32 = 10_000;
/// Maximum number of SQLite steps per byte of a file; valid files take less than one.
const MAX_STEPS_PER_BYTE: u64 = 16;
/// Step limit for small files.
const MIN_STEP_LIMIT: u64 = 10_000_000;
/// Maximum length of a text or blob in bytes; the outline of a whole city is shorter.
const MAX_CELL_LENGTH: i32 = 64 << 20;

/// A SQLite file open for reading.
pub(super) struct Database {
    connection: Connection,
    /// Size of the file in bytes, which limits its content whatever its pages claim.
    length: u64,
}

pub(super) fn is_sqlite(path: &Path) -> bool {
    crate::format::head(path, MAGIC.len() as u64).is_ok_and(|head| head == MAGIC)
}

impl Database {
    /// Opens a file as immutable: locks of other programs are ignored, and no files are written next to it. A
    /// file with unfinished changes (`-wal`, `-journal`) next to it is refused.
    pub(super) fn open(path: &Path) -> Result<Self, FormatError> {
        let refuse = |cause| FormatError::file(path, cause);
        let length = check_header(path).map_err(refuse)?;
        for ending in ["-wal", "-journal"] {
            let mut pending = path.as_os_str().to_owned();
            pending.push(ending);
            if std::fs::metadata(&pending).is_ok_and(|about| about.len() > 0) {
                return Err(refuse(Cause::schema(
                    "the database",
                    format!("locked or left with unfinished changes (`{}`)", Path::new(&pending).display()),
                    "a complete file; close the program that writes it, or open it once with `sqlite3` to \
                     complete it",
                )));
            }
        }
        let flags =
            OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let mut connection = Connection::open_with_flags(address(path).map_err(refuse)?, flags)
            .map_err(|e| refuse(refusal("the database", &e)))?;
        connection
            .set_limit(Limit::SQLITE_LIMIT_LENGTH, MAX_CELL_LENGTH)
            .and_then(|_| {
                connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON")
            })
            .map_err(|e| refuse(refusal("the database", &e)))?;
        // Damaged pages can refer to one another without end, even in the list of tables.
        let mut left =
            (length.saturating_mul(MAX_STEPS_PER_BYTE).max(MIN_STEP_LIMIT)) / STEPS_PER_CHECK as u64;
        let stop = move || {
            left = left.saturating_sub(1);
            left == 0
        };
        connection
            .progress_handler(STEPS_PER_CHECK, Some(stop))
            .map_err(|e| refuse(refusal("the database", &e)))?;
        Ok(Self { connection, length })
    }

    pub(super) fn has(&self, table: &str) -> Result<bool, Cause> {
        Ok(!self.columns(table)?.is_empty())
    }

    /// Returns the columns of a table, none if it is missing. Views, virtual tables and generated columns are
    /// ignored, because they could run arbitrary computations.
    fn columns(&self, table: &str) -> Result<Vec<String>, Cause> {
        let query = || -> rusqlite::Result<Vec<String>> {
            let stored = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = ?1 \
                          AND sql LIKE 'create table %'";
            if self.connection.query_row(stored, [table], |row| row.get::<_, i64>(0))? == 0 {
                return Ok(Vec::new());
            }
            let mut about = self.connection.prepare(&format!("PRAGMA table_info({})", quoted(table)))?;
            about.query_map([], |row| row.get(1))?.collect()
        };
        query().map_err(|e| refusal(&format!("table `{table}`"), &e))
    }

    /// Calls `take` with the given columns of each row of a table, in file order. The first column identifies
    /// the row in error messages. A column with the prefix `?` is optional; if it is missing, its cells are
    /// NULL.
    pub(super) fn each(
        &self,
        table: &str,
        columns: &[&str],
        mut take: impl FnMut(&Cells<'_>) -> Result<(), Cause>,
    ) -> Result<(), Cause> {
        let found = self.columns(table)?;
        if found.is_empty() {
            return Err(Cause::schema(
                format!("table `{table}`"),
                "missing",
                "a table of nuPlan; fetch the file again",
            ));
        }
        let exists = |column: &str| found.iter().any(|f| f.eq_ignore_ascii_case(column));
        if let Some(missing) = columns.iter().find(|c| !c.starts_with('?') && !exists(c)) {
            let expected = format!("a column of this table, which has {}", found.join(", "));
            return Err(Cause::schema(format!("column `{table}.{missing}`"), "missing", expected));
        }
        let failed = |e: rusqlite::Error| refusal(&format!("table `{table}`"), &e);
        let named = |column: &&str| match column.strip_prefix('?') {
            Some(name) if !exists(name) => "NULL".to_owned(),
            Some(name) => quoted(name),
            None => quoted(column),
        };
        let list: Vec<String> = columns.iter().map(named).collect();
        let query = format!("SELECT {} FROM {}", list.join(", "), quoted(table));
        let mut statement = self.connection.prepare(&query).map_err(failed)?;
        let mut rows = statement.query([]).map_err(failed)?;
        let mut bytes = 0_u64;
        while let Some(row) = rows.next().map_err(failed)? {
            let cells = Cells { table, columns, row };
            // A damaged file can return the same page many times.
            bytes += 4 + cells.bytes();
            if bytes > self.length.saturating_mul(4) {
                let found = format!("longer than the file ({} bytes)", self.length);
                return Err(Cause::schema(
                    format!("table `{table}`"),
                    found,
                    "no longer than the file; fetch the file again",
                ));
            }
            take(&cells)?;
        }
        Ok(())
    }
}

/// Checks the header of a file against its length, and returns the length.
fn check_header(path: &Path) -> Result<u64, Cause> {
    let mut file = open_local(path).map_err(Cause::read)?;
    let length = file.metadata().map_err(Cause::read)?.len();
    let mut header = Vec::with_capacity(HEADER_LENGTH);
    file.by_ref().take(HEADER_LENGTH as u64).read_to_end(&mut header).map_err(Cause::read)?;
    if header.is_empty()
        || (header.len() < HEADER_LENGTH && MAGIC.starts_with(&header[..header.len().min(MAGIC.len())]))
    {
        let (found, expected) = (header.len() as u64, HEADER_LENGTH as u64);
        return Err(Cause::Truncated { what: "the header of the database", found, expected });
    }
    if !header.starts_with(MAGIC) {
        return Err(Cause::schema(
            "the beginning of the file",
            "not that of a SQLite database",
            "`SQLite format 3`; decrypt the file or fetch it again",
        ));
    }
    let word = |at: usize| u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let page = match u16::from_be_bytes([header[16], header[17]]) {
        1 => 65_536,
        size => u64::from(size),
    };
    // The number of pages is valid only if the writer was recent enough to keep it up to date.
    let expected = if word(24) == word(92) { u64::from(word(28)) * page } else { 0 };
    if length < expected {
        return Err(Cause::Truncated { what: "the database", found: length, expected });
    }
    Ok(length)
}

/// Returns the URI of a file for SQLite.
fn address(path: &Path) -> Result<String, Cause> {
    let whole: PathBuf = std::path::absolute(path).map_err(Cause::read)?;
    let mut address = String::from("file:");
    let bytes = whole.as_os_str().as_encoded_bytes();
    if !bytes.starts_with(b"/") {
        address.push('/');
    }
    for byte in bytes {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'/' | b'.' | b'_' | b'-' | b':' => {
                address.push(char::from(*byte));
            }
            b'\\' if cfg!(windows) => address.push('/'),
            other => {
                write!(address, "%{other:02X}").map_err(|e| Cause::read(io::Error::other(e)))?;
            }
        }
    }
    address.push_str("?immutable=1");
    Ok(address)
}

fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// Converts an error of SQLite.
fn refusal(what: &str, error: &rusqlite::Error) -> Cause {
    let (found, expected) = match error.sqlite_error_code() {
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => {
            ("locked", "a file that no other program has open; close that program or copy the file")
        }
        Some(ErrorCode::NotADatabase) => {
            ("not a SQLite database", "a SQLite database; decrypt the file or fetch it again")
        }
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::SystemIoFailure) => {
            ("damaged", "a valid SQLite database; fetch the file again")
        }
        Some(ErrorCode::OperationInterrupted) => (
            "damaged: its pages refer to one another without end",
            "a valid SQLite database; fetch the file again",
        ),
        Some(ErrorCode::TooBig) => ("longer than 64 MiB in one cell", "shorter cells; fetch the file again"),
        _ => return Cause::Undecodable(format!("{what}: {error}")),
    };
    Cause::schema(what, format!("{found} ({error})"), expected)
}

pub(super) struct Cells<'a> {
    table: &'a str,
    columns: &'a [&'a str],
    row: &'a Row<'a>,
}

impl Cells<'_> {
    fn get(&self, column: usize) -> ValueRef<'_> {
        self.row.get_ref(column).unwrap_or(ValueRef::Null)
    }

    fn bytes(&self) -> u64 {
        let length = |i| match self.get(i) {
            ValueRef::Text(cell) | ValueRef::Blob(cell) => cell.len() as u64,
            _ => 0,
        };
        (0..self.columns.len()).map(length).sum()
    }

    /// Returns the table, the column and the row for error messages.
    pub(super) fn field(&self, column: usize) -> String {
        let name = self.columns[column].trim_start_matches('?');
        format!("`{}.{name}` of row {}", self.table, shown(self.get(0)))
    }

    /// Returns the error of an invalid cell.
    pub(super) fn wrong(&self, column: usize, expected: impl Into<String>) -> Cause {
        Cause::value(self.field(column), shown(self.get(column)), expected)
    }

    /// Returns a number; NaN for NULL, as SQLite stores NaN as NULL.
    pub(super) fn number(&self, column: usize) -> Result<f64, Cause> {
        match self.get(column) {
            ValueRef::Null => Ok(f64::NAN),
            ValueRef::Real(v) => Ok(v),
            ValueRef::Integer(v) => Ok(v as f64),
            _ => Err(self.wrong(column, "a number")),
        }
    }

    /// Returns a whole number, which may be stored as a float (GDAL does this for nullable columns) or a
    /// text; `None` for NULL.
    pub(super) fn whole(&self, column: usize) -> Result<Option<i64>, Cause> {
        match self.get(column) {
            ValueRef::Null => Ok(None),
            ValueRef::Integer(v) => Ok(Some(v)),
            ValueRef::Real(v) if v.fract() == 0.0 && v.abs() < 9e15 => Ok(Some(v as i64)),
            ValueRef::Text(t) => match std::str::from_utf8(t).ok().map(str::trim) {
                Some("") => Ok(None),
                Some(t) => t.parse().map(Some).map_err(|_| self.wrong(column, "a whole number")),
                None => Err(self.wrong(column, "a whole number")),
            },
            _ => Err(self.wrong(column, "a whole number")),
        }
    }

    pub(super) fn must_whole(&self, column: usize) -> Result<i64, Cause> {
        self.whole(column)?.ok_or_else(|| self.wrong(column, "a whole number"))
    }

    /// Returns a text, empty for NULL.
    pub(super) fn text(&self, column: usize) -> Result<String, Cause> {
        match self.get(column) {
            ValueRef::Null => Ok(String::new()),
            ValueRef::Text(t) => {
                String::from_utf8(t.to_vec()).map_err(|_| self.wrong(column, "text in UTF-8"))
            }
            // A list of one id may be stored as a number.
            ValueRef::Integer(v) => Ok(v.to_string()),
            _ => Err(self.wrong(column, "a text")),
        }
    }

    /// Returns a token; `None` for NULL.
    pub(super) fn token(&self, column: usize) -> Result<Option<Token>, Cause> {
        match self.get(column) {
            ValueRef::Null => Ok(None),
            ValueRef::Blob(b) => {
                Token::of_bytes(b).map(Some).ok_or_else(|| self.wrong(column, "a token of 8 bytes"))
            }
            _ => Err(self.wrong(column, "a token of 8 bytes")),
        }
    }

    pub(super) fn must_token(&self, column: usize) -> Result<Token, Cause> {
        self.token(column)?.ok_or_else(|| self.wrong(column, "a token of 8 bytes"))
    }

    pub(super) fn blob(&self, column: usize, expected: &str) -> Result<&[u8], Cause> {
        match self.get(column) {
            ValueRef::Blob(b) => Ok(b),
            _ => Err(self.wrong(column, expected)),
        }
    }
}

/// Formats a cell for error messages; long cells are truncated.
fn shown(cell: ValueRef<'_>) -> String {
    match cell {
        ValueRef::Null => "NULL".into(),
        ValueRef::Integer(v) => v.to_string(),
        ValueRef::Real(v) => v.to_string(),
        ValueRef::Text(t) => format!("`{}`", String::from_utf8_lossy(&t[..t.len().min(60)])),
        ValueRef::Blob(b) => match Token::of_bytes(b) {
            Some(token) => token.to_string(),
            None => format!("{} bytes", b.len()),
        },
    }
}
