//! Malicious databases that try to run code or exhaust time or memory.

use std::fs;
use std::time::{Duration, Instant};

use rusqlite::Connection;

use super::{all, refusal};
use reactsim_test_support::nuplan::Fixture;

/// Maximum time to refuse such a file, for a test build on a busy machine.
const TIME_LIMIT: Duration = Duration::from_secs(20);

fn quick_refusal(fixture: &Fixture) -> String {
    let begin = Instant::now();
    let error = refusal(&fixture.log);
    assert!(begin.elapsed() < TIME_LIMIT, "{:?}", begin.elapsed());
    error
}

#[test]
fn computed_tables_are_ignored() {
    let endless = "WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) SELECT n";
    for (sql, expected) in [
        (
            format!("DROP TABLE track; CREATE VIEW track AS {endless} AS token, n AS category_token FROM c"),
            "table `track` is missing",
        ),
        (
            "DROP TABLE track; CREATE VIEW track AS SELECT load_extension('x') AS token, 1 AS category_token".into(),
            "table `track` is missing",
        ),
        (
            "DROP TABLE track; CREATE TABLE track (token BLOB, category_token BLOB AS (zeroblob(1000000000)))".into(),
            "column `track.category_token` is missing",
        ),
        (
            "DROP TABLE track; CREATE VIRTUAL TABLE track USING fts5 (token, category_token)".into(),
            "table `track` is missing",
        ),
        // In a form that SQLite never writes.
        (
            "DROP TABLE track; CREATE VIRTUAL TABLE track USING fts5 (token, category_token); PRAGMA writable_schema = ON; \
             UPDATE sqlite_master SET sql = 'CREATE /**/' || substr(sql, 8), rootpage = 2 WHERE name = 'track'"
                .into(),
            "table `track`",
        ),
    ] {
        let error = quick_refusal(&Fixture::write().log(&sql));
        assert!(error.contains(expected), "{sql}: {error}");
    }
    // Reading activates no triggers.
    let fixture = Fixture::write().log(
        "CREATE TRIGGER t AFTER INSERT ON track BEGIN DELETE FROM track; END; CREATE TABLE more (a); \
         CREATE TRIGGER u AFTER UPDATE ON more BEGIN SELECT load_extension('x'); END",
    );
    assert!(all(&fixture.log).iter().all(Result::is_ok));
}

#[test]
fn long_cells_are_refused() {
    let fixture = Fixture::write().map("UPDATE crosswalks SET geom = zeroblob(70000000)");
    let error = quick_refusal(&fixture);
    assert!(error.contains("longer than 64 MiB in one cell"), "{error}");
}

#[test]
fn long_lists_and_crowded_windows_are_refused() {
    let fixture = Fixture::write()
        .map("UPDATE stop_polygons SET lane_connector_fids = replace(hex(zeroblob(20000)), '00', '3,')");
    let error = quick_refusal(&fixture);
    assert!(
        error.contains("`stop_polygons.lane_connector_fids` of row 7") && error.contains("at most 1000 fids"),
        "{error}"
    );
    let fixture = Fixture::write().log(
        "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n WHERE i < 10000) \
         INSERT INTO track SELECT CAST(printf('u%07d', i) AS BLOB), (SELECT min(token) FROM category) FROM n; \
         INSERT INTO lidar_box SELECT token, x'7000000000000014', token, 1, 1, 1, 1, 0, 0, 0 FROM track WHERE token > x'75'",
    );
    let error = quick_refusal(&fixture);
    assert!(error.contains("a box of one of at most 10000 objects in 91 frames"), "{error}");
}

#[test]
fn noise_after_a_valid_header() {
    let fixture = Fixture::write();
    let mut file = fs::read(&fixture.log).unwrap();
    file[100..].iter_mut().enumerate().for_each(|(i, b)| *b = (i.wrapping_mul(2_654_435_761) >> 13) as u8);
    fs::write(&fixture.log, file).unwrap();
    let error = quick_refusal(&fixture);
    assert!(error.contains("damaged") && error.contains("fetch the file again"), "{error}");
}

/// Writes the header of an interior page of a table at `at`, all of whose children are the page `child`.
fn inner(page: &mut [u8], at: usize, first: u32, child: u32) {
    let fits = (page.len() - at - 12) / 7;
    let head = [5, 0, 0, (fits >> 8) as u8, fits as u8, 0, 0, 0];
    page[at..at + 8].copy_from_slice(&head);
    page[at + 8..at + 12].copy_from_slice(&child.to_be_bytes());
    let mut end = page.len();
    for i in 0..fits {
        end -= 5;
        let child = if i == 0 { first } else { child };
        page[end..end + 4].copy_from_slice(&child.to_be_bytes());
        page[end + 4] = 1;
        page[at + 12 + 2 * i..at + 14 + 2 * i].copy_from_slice(&(end as u16).to_be_bytes());
    }
    page[at + 5..at + 7].copy_from_slice(&(end as u16).to_be_bytes());
}

#[test]
fn endless_page_references_are_refused() {
    let fixture = Fixture::write();
    // The list of tables is a tree of a few pages with billions of paths, each of which ends at the index of
    // the only table.
    let connection = Connection::open_in_memory().unwrap();
    connection.execute_batch("PRAGMA page_size = 512; CREATE TABLE t (a UNIQUE)").unwrap();
    connection.execute("VACUUM INTO ?1", [fixture.log.with_file_name("t.db").to_str().unwrap()]).unwrap();
    let mut file = fs::read(fixture.log.with_file_name("t.db")).unwrap();
    assert_eq!(file.len(), 3 * 512);
    let (table, index) = (file.len() as u32 / 512 + 1, file.len() as u32 / 512 + 2);
    // Both entries are copied to leaves of their own; that of the table occurs once.
    let leaf = |keep: usize| {
        let mut page = vec![0; 512];
        page[512 - 412..].copy_from_slice(&file[100..512]);
        let cell = [file[108 + 2 * keep], file[109 + 2 * keep]];
        page[..8].copy_from_slice(&[13, 0, 0, 0, 1, cell[0], cell[1], 0]);
        page[8..10].copy_from_slice(&cell);
        page[10..100].fill(0);
        page
    };
    let leaves = [leaf(0), leaf(1)].concat();
    file.extend(leaves);
    let levels = 6;
    for level in 0..levels {
        let mut page = vec![0; 512];
        let below = if level == 0 { index } else { index + level };
        // The first path leads to the table before its index.
        inner(&mut page, 0, if level == 0 { index } else { below }, below);
        file.extend(page);
    }
    file[100..512].fill(0);
    inner(&mut file[..512], 100, table, index + levels);
    let pages = (file.len() / 512) as u32;
    file[28..32].copy_from_slice(&pages.to_be_bytes());
    fs::write(&fixture.log, file).unwrap();
    let error = quick_refusal(&fixture);
    assert!(error.contains("pages refer to one another without end"), "{error}");
}
