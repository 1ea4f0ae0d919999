//! SQLite files, opened for reading only; what is read is asked by table and column, and refused by table, column and row.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, ErrorCode, OpenFlags, Row};

use super::token::Token;
use crate::formats::error::{Cause, FormatError};

/// The first bytes of every SQLite file.
const MAGIC: &[u8] = b"SQLite format 3\0";
/// Length of the header of a SQLite file.
const HEADER: usize = 100;
/// How many steps of SQLite's machine are between two questions of whether it should go on.
const STEPS: i32 = 10_000;
/// Most steps for each byte of a file, and for the whole of a short one: what is sound takes less than one for each byte.
const MOST_STEPS: (u64, u64) = (16, 10_000_000);
/// The longest text or blob that is read: the outline of a whole city is shorter.
const LONGEST: i32 = 64 << 20;

/// A SQLite file that is open for reading.
pub(super) struct Database {
    connection: Connection,
    /// Bytes of the file: it can not hold more than this, whatever its pages claim.
    length: u64,
}

/// Whether a file begins as SQLite files do.
pub(super) fn is_sqlite(path: &Path) -> bool {
    crate::formats::format::head(path, MAGIC.len() as u64).is_ok_and(|head| head == MAGIC)
}

impl Database {
    /// Opens a file. It is taken as one that nobody changes, so that locks of other programs do not matter and nothing is
    /// written beside it; one with unfinished changes beside it is refused.
    pub(super) fn open(path: &Path) -> Result<Self, FormatError> {
        let refuse = |cause| FormatError::file(path, cause);
        let length = check_header(path).map_err(refuse)?;
        for ending in ["-wal", "-journal"] {
            let mut beside = path.as_os_str().to_owned();
            beside.push(ending);
            if std::fs::metadata(&beside).is_ok_and(|about| about.len() > 0) {
                return Err(refuse(Cause::schema(
                    "the database",
                    format!("locked or left with unfinished changes (`{}`)", Path::new(&beside).display()),
                    "a finished file; close the program that writes it, or open it once with `sqlite3` so that it finishes",
                )));
            }
        }
        let flags =
            OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let mut connection = Connection::open_with_flags(address(path).map_err(refuse)?, flags)
            .map_err(|e| refuse(refusal("the database", &e)))?;
        connection
            .set_limit(Limit::SQLITE_LIMIT_LENGTH, LONGEST)
            .and_then(|_| {
                connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON")
            })
            .map_err(|e| refuse(refusal("the database", &e)))?;
        // Damaged pages can lead to one another, also while SQLite looks for the tables.
        let mut left = (length.saturating_mul(MOST_STEPS.0).max(MOST_STEPS.1)) / STEPS as u64;
        let stop = move || {
            left = left.saturating_sub(1);
            left == 0
        };
        connection.progress_handler(STEPS, Some(stop)).map_err(|e| refuse(refusal("the database", &e)))?;
        Ok(Self { connection, length })
    }

    /// Whether there is a table of this name.
    pub(super) fn has(&self, table: &str) -> Result<bool, Cause> {
        Ok(!self.columns(table)?.is_empty())
    }

    /// The columns of a table, none where it is missing. Views and virtual tables, which could compute anything, are no tables,
    /// and computed columns no columns.
    fn columns(&self, table: &str) -> Result<Vec<String>, Cause> {
        let ask = || -> rusqlite::Result<Vec<String>> {
            let stored = "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name = ?1 \
                          AND sql LIKE 'create table %'";
            if self.connection.query_row(stored, [table], |row| row.get::<_, i64>(0))? == 0 {
                return Ok(Vec::new());
            }
            let mut about = self.connection.prepare(&format!("PRAGMA table_info({})", quoted(table)))?;
            about.query_map([], |row| row.get(1))?.collect()
        };
        ask().map_err(|e| refusal(&format!("table `{table}`"), &e))
    }

    /// Calls `take` with each row of a table, in the order of the file, with the columns asked; the first one names the row in
    /// messages. A column that begins with `?` may be missing and is NULL then.
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
        let there = |column: &str| found.iter().any(|f| f.eq_ignore_ascii_case(column));
        if let Some(missing) = columns.iter().find(|c| !c.starts_with('?') && !there(c)) {
            let expected = format!("a column of this table, which has {}", found.join(", "));
            return Err(Cause::schema(format!("column `{table}.{missing}`"), "missing", expected));
        }
        let failed = |e: rusqlite::Error| refusal(&format!("table `{table}`"), &e);
        let named = |column: &&str| match column.strip_prefix('?') {
            Some(name) if !there(name) => "NULL".to_owned(),
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
            // A damaged file can show the same page again and again.
            bytes += 4 + cells.bytes();
            if bytes > self.length.saturating_mul(4) {
                let found = format!("longer than the file ({} bytes)", self.length);
                return Err(Cause::schema(
                    format!("table `{table}`"),
                    found,
                    "what fits; fetch the file again",
                ));
            }
            take(&cells)?;
        }
        Ok(())
    }
}

/// Checks the first bytes of a file against its length, which is returned.
fn check_header(path: &Path) -> Result<u64, Cause> {
    let mut file = File::open(path).map_err(Cause::read)?;
    let length = file.metadata().map_err(Cause::read)?.len();
    let mut header = Vec::with_capacity(HEADER);
    file.by_ref().take(HEADER as u64).read_to_end(&mut header).map_err(Cause::read)?;
    if header.is_empty()
        || (header.len() < HEADER && MAGIC.starts_with(&header[..header.len().min(MAGIC.len())]))
    {
        let (found, expected) = (header.len() as u64, HEADER as u64);
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
    // The number of pages is only stated where the writer was new enough to keep it up to date.
    let expected = if word(24) == word(92) { u64::from(word(28)) * page } else { 0 };
    if length < expected {
        return Err(Cause::Truncated { what: "the database", found: length, expected });
    }
    Ok(length)
}

/// The address of a file for SQLite.
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

/// What SQLite's answer means.
fn refusal(what: &str, error: &rusqlite::Error) -> Cause {
    let (found, expected) = match error.sqlite_error_code() {
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => {
            ("locked", "a file that no other program holds; close that program or copy the file")
        }
        Some(ErrorCode::NotADatabase) => ("no SQLite database", "one; decrypt the file or fetch it again"),
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::SystemIoFailure) => {
            ("damaged", "a sound SQLite database; fetch the file again")
        }
        Some(ErrorCode::OperationInterrupted) => (
            "damaged: its pages lead to one another without end",
            "a sound SQLite database; fetch the file again",
        ),
        Some(ErrorCode::TooBig) => ("longer than 64 MiB in one cell", "shorter cells; fetch the file again"),
        _ => return Cause::Undecodable(format!("{what}: {error}")),
    };
    Cause::schema(what, format!("{found} ({error})"), expected)
}

/// The cells of one row.
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

    /// The table, the column and the row, for messages.
    pub(super) fn field(&self, column: usize) -> String {
        let name = self.columns[column].trim_start_matches('?');
        format!("`{}.{name}` of row {}", self.table, shown(self.get(0)))
    }

    /// The refusal of a cell.
    pub(super) fn wrong(&self, column: usize, expected: impl Into<String>) -> Cause {
        Cause::value(self.field(column), shown(self.get(column)), expected)
    }

    /// A number; NaN where there is none. SQLite stores NaN as NULL.
    pub(super) fn number(&self, column: usize) -> Result<f64, Cause> {
        match self.get(column) {
            ValueRef::Null => Ok(f64::NAN),
            ValueRef::Real(v) => Ok(v),
            ValueRef::Integer(v) => Ok(v as f64),
            _ => Err(self.wrong(column, "a number")),
        }
    }

    /// A whole number, stored as one or as a fraction without one (GDAL does so with columns that may be empty); `None` for NULL.
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

    /// A whole number that must be there.
    pub(super) fn must_whole(&self, column: usize) -> Result<i64, Cause> {
        self.whole(column)?.ok_or_else(|| self.wrong(column, "a whole number"))
    }

    /// A text, empty for NULL.
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

    /// A token; `None` for NULL.
    pub(super) fn token(&self, column: usize) -> Result<Option<Token>, Cause> {
        match self.get(column) {
            ValueRef::Null => Ok(None),
            ValueRef::Blob(b) => {
                Token::of_bytes(b).map(Some).ok_or_else(|| self.wrong(column, "a token of 8 bytes"))
            }
            _ => Err(self.wrong(column, "a token of 8 bytes")),
        }
    }

    /// A token that must be there.
    pub(super) fn must_token(&self, column: usize) -> Result<Token, Cause> {
        self.token(column)?.ok_or_else(|| self.wrong(column, "a token of 8 bytes"))
    }

    /// A blob that must be there.
    pub(super) fn blob(&self, column: usize, expected: &str) -> Result<&[u8], Cause> {
        match self.get(column) {
            ValueRef::Blob(b) => Ok(b),
            _ => Err(self.wrong(column, expected)),
        }
    }
}

/// A cell for messages: what is long is cut.
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
