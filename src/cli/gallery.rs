//! What `report --format html` and `view` have in common: which runs are shown, and where their scenarios lie.

use std::path::PathBuf;

use super::{find_inputs, shipped};
use crate::evaluation::Shelf;
use crate::report::page::{Gallery, Member};

/// Opens the runs in these folders with the scenarios at these paths. The shipped benchmark is always at hand.
pub(super) fn open(folders: &[PathBuf], scenarios: &[PathBuf]) -> anyhow::Result<Gallery> {
    let mut shelf = Shelf::default();
    shelf.add(shipped::benchmark(usize::MAX));
    for input in find_inputs(scenarios)? {
        shelf.add_file(&input)?;
    }
    let members = names(folders).into_iter().zip(folders);
    let members =
        members.map(|(name, folder)| Member { name, folder: folder.clone(), study: None }).collect();
    Ok(Gallery::open(members, shelf)?)
}

/// The names of run folders; their whole paths where the names alone are not unique.
pub(super) fn names(runs: &[PathBuf]) -> Vec<String> {
    let short: Vec<String> = runs
        .iter()
        .map(|p| p.file_name().map_or_else(|| p.display().to_string(), |n| n.to_string_lossy().into_owned()))
        .collect();
    let mut sorted = short.clone();
    sorted.sort();
    sorted.dedup();
    if sorted.len() == short.len() { short } else { runs.iter().map(|p| p.display().to_string()).collect() }
}
