//! The scenarios of finished runs, where they still are.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{mem, slice};

use reactsim_files::{as_url, name_of};
use reactsim_formats::Input;

use super::read_provenance;
use crate::error::EvaluationError;
use crate::source::Source;
use crate::source::scenario_files::ScenarioFiles;
use crate::spec::{ReadingSpec, RunSpec, ScenarioSpec};

impl ScenarioFiles {
    /// Returns the given scenarios of runs. The shipped benchmark is always available, and so are inputs of
    /// the runs that are where the specifications of the runs name them, or in the current folder.
    ///
    /// # Errors
    /// [`EvaluationError`] if a given file or the provenance of a run cannot be read.
    pub fn of_runs(runs: &[&Path], given: &[Input]) -> Result<Self, EvaluationError> {
        let mut files = Self::default();
        files.add(Source::shipped(usize::MAX));
        for input in given {
            files.add_file(input)?;
        }
        for run in runs {
            let mut missing = read_provenance(run)?.inputs;
            missing.retain(|file| !files.has(file));
            let names: BTreeSet<String> = missing.into_iter().map(|file| file.name).collect();
            let here = names.iter().map(PathBuf::from).filter(|path| path.is_file());
            let mut inputs: Vec<Input> =
                here.flat_map(|path| found(&ReadingSpec::default(), slice::from_ref(&path))).collect();
            inputs.extend(if names.is_empty() { Vec::new() } else { specified(run, &names) });
            for input in inputs.iter().filter(|input| names.contains(name_of(&input.path).as_ref())) {
                // A file of the same name may have other scenarios; then they are missing, which the page
                // says.
                files.add_file(input).ok();
            }
        }
        Ok(files)
    }
}

/// Returns the scenario files that the specification of a run names, as far as it has one and they are there.
/// URLs are left out, which may be out of reach; the logs of nuPlan are only searched if their filter has one
/// of these names.
fn specified(run: &Path, names: &BTreeSet<String>) -> Vec<Input> {
    let Ok(Some(spec)) = RunSpec::of_run(run) else { return Vec::new() };
    let ScenarioSpec { scenarios, mut reading, .. } = spec.subject.input;
    let nuplan = mem::take(&mut reading.nuplan);
    let is_here = |path: &&PathBuf| as_url(path).is_none();
    let paths = scenarios.iter().filter(is_here);
    let mut inputs: Vec<Input> = paths.flat_map(|path| found(&reading, slice::from_ref(path))).collect();
    let is_named = nuplan.filter.as_ref().is_some_and(|filter| names.contains(name_of(filter).as_ref()));
    if is_named && nuplan.nuplan.iter().chain(&nuplan.filter).chain(&nuplan.maps).all(|path| is_here(&path)) {
        reading.nuplan = nuplan;
        inputs.extend(found(&reading, &[]));
    }
    inputs
}

/// Returns the inputs at these paths, none if one cannot be read: a path hides no other.
fn found(reading: &ReadingSpec, paths: &[PathBuf]) -> Vec<Input> {
    reading.find_inputs(paths).map(|(inputs, _)| inputs).unwrap_or_default()
}
