use std::path::Path;

use reactsim_test_support::nuplan::Fixture;
use rusqlite::Connection;

/// The file that names maps and their versions.
pub const LIST: &str = r#"{"town": {"version": "1.0", "layers": {}}}"#;

/// Takes out what is there many times, and stores the rest in small pages.
fn small(path: &Path, sql: &str) -> Vec<u8> {
    let connection = Connection::open(path).expect("a database");
    let shrink = format!("PRAGMA journal_mode = OFF; {sql}; PRAGMA page_size = 512; VACUUM");
    connection.execute_batch(&shrink).expect("a change of the database");
    drop(connection);
    std::fs::read(path).expect("a database")
}

/// A log with one scenario.
pub fn log() -> Vec<u8> {
    small(
        &Fixture::write().log,
        "DELETE FROM lidar_box WHERE rowid > 90; DELETE FROM traffic_light_status WHERE rowid > 40",
    )
}

/// Its map.
pub fn map() -> Vec<u8> {
    small(&Fixture::write().map, "SELECT 1")
}
