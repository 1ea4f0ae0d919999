mod damage;
mod expected;
mod hostile;
mod fixture;
mod small;

use std::path::{Path, PathBuf};

use crate::formats::{self, FormatError};
use crate::scene::Scenario;

/// Returns the folder of the sample data, if it exists.
fn samples() -> Option<PathBuf> {
    let found = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/nuplan"));
    if !found.exists() {
        use std::io::Write;
        writeln!(std::io::stderr().lock(), "skipped: no data/nuplan next to the repository").ok();
        return None;
    }
    Some(found.to_owned())
}

fn all(path: &Path) -> Vec<Result<Scenario, FormatError>> {
    match formats::open(path) {
        Ok(scenarios) => scenarios.collect(),
        Err(error) => vec![Err(error)],
    }
}

/// Returns the only error message of a file.
fn refusal(path: &Path) -> String {
    let mut all = all(path);
    assert_eq!(all.len(), 1, "{all:?}");
    all.remove(0).unwrap_err().to_string()
}
