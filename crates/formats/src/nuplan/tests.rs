mod damage;
mod expected;
mod filter;
mod hostile;
mod small;

use std::path::Path;

use reactsim_scene::Scenario;

use crate::FormatError;

fn all(path: &Path) -> Vec<Result<Scenario, FormatError>> {
    match crate::open(path) {
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
