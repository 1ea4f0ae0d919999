//! Shared parts of the tests of all crates: data next to the repository, and small inputs made by hand.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::env;
use std::io::{self, Write};
use std::panic::Location;
use std::path::{Path, PathBuf};
use std::thread;

pub mod documents;
#[cfg(feature = "nuplan")]
pub mod nuplan;
pub mod pickle;
pub mod proto;

/// Environment variable that makes tests fail where the shared data is missing, instead of skipping them.
const REQUIRED: &str = "REACTSIM_REQUIRE_SHARED";

/// Returns a path in the shared data if it exists; otherwise reports that the test is skipped.
///
/// # Panics
/// If the path does not exist and `REACTSIM_REQUIRE_SHARED` is 1.
#[track_caller]
pub fn shared(path: &str) -> Option<PathBuf> {
    let found = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")).join(path);
    if found.exists() {
        return Some(found);
    }
    assert!(env::var_os(REQUIRED).is_none_or(|v| v != "1"), "{REQUIRED} is set, but {path} is missing");
    skipped(&format!("no {path} next to the repository"));
    None
}

/// Reports that a test is skipped. Writes past the harness, which hides the output of tests that pass.
#[track_caller]
pub fn skipped(why: &str) {
    let at = Location::caller();
    let test = thread::current().name().unwrap_or_default().to_owned();
    writeln!(io::stderr().lock(), "skipped: {test}: {why} ({}:{})", at.file(), at.line()).ok();
}
