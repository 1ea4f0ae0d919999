//! Reading native files in any order.

use std::path::Path;

use reactsim::formats::native::ByNumber;

use super::{good, refusal};
use crate::program::MINI;
use crate::small_scenarios::write;

#[test]
fn scenarios_are_the_same_in_any_order_and_on_any_thread() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mini.parquet");
    let scenarios = good(Path::new(MINI));
    write(&path, &scenarios);
    let file = ByNumber::open(&path).unwrap();
    // More than one row group.
    assert!(file.len() == scenarios.len() && file.len() > 8 && !file.is_empty());
    let read = |from: usize| {
        for number in (0..file.len()).rev().map(|i| (i + from) % scenarios.len()) {
            let (read, expected) = (file.read(number).unwrap(), &scenarios[number]);
            assert_eq!(read.digest(), expected.digest());
            assert_eq!(
                (file.id(number), file.digest(number)),
                (expected.id.as_str(), expected.digest().as_str())
            );
        }
    };
    std::thread::scope(|scope| {
        for from in [0, 5, 9] {
            scope.spawn(move || read(from));
        }
    });
}

#[test]
fn a_file_that_is_changed_meanwhile_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mini.parquet");
    let mut scenarios = good(Path::new(MINI));
    write(&path, &scenarios);
    let file = ByNumber::open(&path).unwrap();
    let held = ByNumber::open(&path).unwrap();
    scenarios.reverse();
    write(&path, &scenarios);
    // An open file keeps its content; the first read in another thread finds the new file.
    file.read(3).unwrap();
    let told = std::sync::Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..16 {
            scope.spawn(|| {
                if let Err(error) = held.read(3) {
                    told.lock().unwrap().push(error.to_string());
                }
            });
        }
    });
    for text in told.into_inner().unwrap() {
        assert!(text.contains("the file has changed since"), "{text}");
    }
    std::fs::write(&path, b"PAR1").unwrap();
    let error = ByNumber::open(&path).err().unwrap().to_string();
    assert_eq!(error, refusal(&path));
}
