//! Changes of databases, told by the bytes of an input.

use std::path::PathBuf;

use libfuzzer_sys::arbitrary::{Result, Unstructured};
use rusqlite::Connection;
use rusqlite::types::Value;

/// Most changes of one input.
const MOST: usize = 8;

/// Carries out the changes that `data` tells; what SQLite refuses is left out.
pub fn apply(data: &[u8], files: [&mut PathBuf; 2]) {
    let open = |path: &mut PathBuf| {
        let connection = Connection::open(path).expect("a good database");
        connection
            .execute_batch("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF")
            .expect("a good database");
        connection
    };
    let databases = files.map(open);
    let mut bytes = Unstructured::new(data);
    for _ in 0..MOST {
        if bytes.is_empty() || edit(&mut bytes, &databases).is_err() {
            break;
        }
    }
}

fn names(database: &Connection, sql: &str) -> Vec<String> {
    let mut statement = database.prepare(sql).expect("a question");
    let rows = statement.query_map([], |row| row.get::<_, String>(0)).expect("an answer");
    rows.flatten().collect()
}

fn edit(bytes: &mut Unstructured<'_>, databases: &[Connection; 2]) -> Result<()> {
    let database = &databases[usize::from(bytes.arbitrary::<bool>()?)];
    let tables = names(database, "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY rowid");
    if tables.is_empty() {
        return Ok(());
    }
    let table = bytes.choose(&tables)?;
    let columns = names(database, &format!("SELECT name FROM pragma_table_info('{table}')"));
    let column = bytes.choose(&columns)?;
    let row = match bytes.arbitrary::<u8>()? {
        // Often all rows.
        row if row < 100 => "1".to_owned(),
        row => format!("rowid % 221 = {}", row - 100),
    };
    let (sql, values) = match bytes.int_in_range(0..=9)? {
        0..=4 => (format!("UPDATE {table} SET {column} = ?1 WHERE {row}"), vec![value(bytes)?]),
        5 => {
            // A part of what was there, with other bytes in it.
            let cut = bytes.int_in_range(0..=60)?;
            let other = Value::Blob(bytes.arbitrary::<[u8; 4]>()?.to_vec());
            let sql = format!(
                "UPDATE {table} SET {column} = CAST(substr({column}, 1, {cut}) || ?1 || substr({column}, {cut} + 5) AS BLOB) WHERE {row}"
            );
            (sql, vec![other])
        }
        6 => (format!("DELETE FROM {table} WHERE {row}"), vec![]),
        7 => (format!("INSERT INTO {table} SELECT * FROM {table} WHERE {row}"), vec![]),
        8 => (format!("ALTER TABLE {table} DROP COLUMN {column}"), vec![]),
        _ => {
            let other = bytes.choose(&columns)?;
            (format!("UPDATE {table} SET {column} = {other} WHERE {row}"), vec![])
        }
    };
    // An edit that cannot be made changes nothing.
    let _ = database.execute(&sql, rusqlite::params_from_iter(values));
    Ok(())
}

fn value(bytes: &mut Unstructured<'_>) -> Result<Value> {
    const WHOLE: [i64; 12] =
        [0, 1, -1, 2, 3, i64::MAX, i64::MIN, 32_631, 4326, 50_000, 9_007_199_254_740_993, 1_000_000_000];
    const REAL: [f64; 10] =
        [0.0, -0.0, 1e-300, 1e300, f64::INFINITY, f64::NEG_INFINITY, 9e15, 0.5, -1e9, 500_000.0];
    const TEXT: [&str; 9] = [
        "",
        " ",
        "1, 2",
        "epsg:32631",
        "EPSG: 32660",
        "../x",
        "\u{1}\n\u{7f}\u{9b}",
        "9223372036854775808",
        "MergedPointCloud",
    ];
    Ok(match bytes.int_in_range(0..=7)? {
        0 => Value::Null,
        1 => Value::Integer(*bytes.choose(&WHOLE)?),
        2 => Value::Integer(bytes.arbitrary()?),
        3 => Value::Real(*bytes.choose(&REAL)?),
        4 => Value::Real(bytes.arbitrary()?),
        5 => Value::Text((*bytes.choose(&TEXT)?).to_owned()),
        6 => Value::Text(bytes.arbitrary::<&str>()?.to_owned()),
        _ => {
            let length = bytes.int_in_range(0..=400)?.min(bytes.len());
            Value::Blob(bytes.bytes(length)?.to_vec())
        }
    })
}
