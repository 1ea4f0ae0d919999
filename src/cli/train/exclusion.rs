//! Scenarios that are not learned from: those of benchmarks and of files that the user names.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::bail;

use crate::cli::inputs::find_inputs;
use crate::cli::output::count;
use crate::evaluation::{BenchmarkRecord, FileRecord, shipped_benchmark, shipped_ids};
use crate::formats::Input;
use crate::formats::native::ByNumber;

/// Ids of scenarios that are not learned from.
pub(super) struct Exclusion {
    /// Of the shipped benchmark: refused.
    benchmark: BTreeSet<String>,
    /// Of files that the user names: left out.
    named: BTreeSet<String>,
    /// Number of scenarios left out so far.
    left_out: usize,
}

impl Exclusion {
    /// Reads the ids of the scenarios in these files and folders.
    pub(super) fn read(paths: &[PathBuf]) -> anyhow::Result<Self> {
        let benchmark = shipped_ids()?.into_iter().collect();
        let mut named = BTreeSet::new();
        for input in find_inputs(paths)? {
            named.extend(ids(&input)?);
        }
        Ok(Self { benchmark, named, left_out: 0 })
    }

    /// Refuses a file that is a known benchmark.
    pub(super) fn refuse_benchmark(&self, file: &FileRecord) -> anyhow::Result<()> {
        match BenchmarkRecord::of(file) {
            Some(known) => bail!(
                "{}: this is the benchmark {known}, which networks are judged by: learn from others",
                file.name
            ),
            None => Ok(()),
        }
    }

    /// Returns whether a scenario is learned from.
    ///
    /// # Errors
    /// A message for a scenario of the shipped benchmark.
    pub(super) fn admits(&mut self, id: &str, file: &str) -> anyhow::Result<bool> {
        if names(id).any(|name| self.named.contains(name)) {
            self.left_out += 1;
            return Ok(false);
        }
        if names(id).any(|name| self.benchmark.contains(name)) {
            let known = shipped_benchmark().map_or_else(String::new, |known| format!(" {}", known.record));
            bail!(
                "{file}: scenario `{id}` is of the benchmark{known}, which networks are judged by: remove \
                 it, or give --exclude with the file of the benchmark"
            );
        }
        Ok(true)
    }

    /// Returns a text about the number of scenarios that were left out, if some were.
    pub(super) fn report(&self) -> Option<String> {
        (self.left_out > 0).then(|| format!("{} left out (--exclude)", count(self.left_out, "scenario")))
    }
}

/// Returns the id of a scenario and those of the scenarios that its futures are of: `a+idm` has futures of
/// `a`.
fn names(id: &str) -> impl Iterator<Item = &str> {
    std::iter::once(id).chain(id.match_indices('+').map(|(at, _)| &id[..at]))
}

/// Returns the ids of the scenarios of a file.
fn ids(input: &Input) -> anyhow::Result<Vec<String>> {
    if input.format.id() == "native" {
        let file = ByNumber::open(&input.path)?;
        return Ok((0..file.len()).map(|number| file.id(number).to_owned()).collect());
    }
    input.open()?.map(|scenario| Ok(scenario?.id)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn futures_have_the_ids_of_their_scenarios() {
        assert_eq!(names("a").collect::<Vec<_>>(), ["a"]);
        assert_eq!(names("a+b+idm").collect::<Vec<_>>(), ["a+b+idm", "a", "a+b"]);
    }
}
