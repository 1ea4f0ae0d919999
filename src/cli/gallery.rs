//! Runs to show and the location of their scenarios, shared by `report` and `view`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{mem, slice};

use clap::Args;

use super::inputs::find_inputs;
use super::output::say;
use crate::evaluation::{
    EvaluationError, NuplanSpec, ReadingSpec, RunSpec, ScenarioFiles, ScenarioSpec, Source, StudyResults,
    is_study, read_provenance,
};
use crate::files::{as_url, name_of};
use crate::formats::Input;
use crate::report::page::{Gallery, Member};

/// Scenarios of finished runs.
#[derive(Debug, Args)]
pub(super) struct RunScenarioArgs {
    /// Scenarios of the runs, unless they ship with the program, are where the runs read them, or are in the
    /// current folder; may be repeated
    #[arg(long, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    #[command(flatten)]
    nuplan: NuplanSpec,
}

impl RunScenarioArgs {
    /// Returns whether some are given.
    pub(super) fn is_given(&self) -> bool {
        !self.scenarios.is_empty() || self.nuplan != NuplanSpec::default()
    }

    /// Finds the files.
    pub(super) fn inputs(&self) -> anyhow::Result<Vec<Input>> {
        let mut inputs = find_inputs(&self.scenarios)?;
        inputs.extend(self.nuplan.input()?);
        Ok(inputs)
    }
}

/// Opens the runs in these folders, members of studies included, with these scenarios. Says why scenes are
/// unavailable, if they are.
pub(super) fn open(folders: &[PathBuf], scenarios: &RunScenarioArgs) -> anyhow::Result<Gallery> {
    let (members, studies) = members(folders)?;
    let folders: Vec<&Path> = members.iter().map(|member| member.folder.as_path()).collect();
    let files = scenario_files(&folders, &scenarios.inputs()?)?;
    let gallery = Gallery::open(members, studies, files)?;
    for note in gallery.missing_for_scenes() {
        say(format_args!("note: {note}"));
    }
    Ok(gallery)
}

/// Returns these scenarios of runs. The shipped benchmark is always available, and so are inputs of the runs that
/// are where the specifications of the runs name them, or in the current folder.
pub(super) fn scenario_files(runs: &[&Path], given: &[Input]) -> anyhow::Result<ScenarioFiles> {
    let mut scenario_files = ScenarioFiles::default();
    scenario_files.add(Source::shipped(usize::MAX));
    for input in given {
        scenario_files.add_file(input)?;
    }
    for run in runs {
        let mut missing = read_provenance(run)?.inputs;
        missing.retain(|file| !scenario_files.has(file));
        let names: BTreeSet<String> = missing.into_iter().map(|file| file.name).collect();
        let here = names.iter().map(PathBuf::from).filter(|path| path.is_file());
        let mut inputs: Vec<Input> = here.flat_map(|path| find_inputs(&[path]).unwrap_or_default()).collect();
        inputs.extend(if names.is_empty() { Vec::new() } else { specified(run, &names) });
        for input in inputs.iter().filter(|input| names.contains(name_of(&input.path).as_ref())) {
            // A file of the same name may have other scenarios; then they are missing, which the page says.
            scenario_files.add_file(input).ok();
        }
    }
    Ok(scenario_files)
}

/// Returns the scenario files that the specification of a run names, as far as it has one and they are there.
/// URLs are left out, which may be out of reach; the logs of nuPlan are only searched if their filter has one
/// of these names.
fn specified(run: &Path, names: &BTreeSet<String>) -> Vec<Input> {
    let Ok(Some(spec)) = RunSpec::of_run(run) else { return Vec::new() };
    let ScenarioSpec { scenarios, mut reading, .. } = spec.subject.input;
    let nuplan = mem::take(&mut reading.nuplan);
    let is_here = |path: &&PathBuf| as_url(path).is_none();
    // A path that cannot be read hides no other.
    let at = |reading: &ReadingSpec, paths: &[PathBuf]| {
        reading.find_inputs(paths).map(|(inputs, _)| inputs).unwrap_or_default()
    };
    let paths = scenarios.iter().filter(is_here);
    let mut inputs: Vec<Input> = paths.flat_map(|path| at(&reading, slice::from_ref(path))).collect();
    let is_named = nuplan.filter.as_ref().is_some_and(|filter| names.contains(name_of(filter).as_ref()));
    if is_named && nuplan.nuplan.iter().chain(&nuplan.filter).chain(&nuplan.maps).all(|path| is_here(&path)) {
        reading.nuplan = nuplan;
        inputs.extend(at(&reading, &[]));
    }
    inputs
}

/// Studies with their names.
type Studies = Vec<(String, StudyResults)>;

/// Returns the runs in these folders, and the studies that some of them belong to.
pub(super) fn members(folders: &[PathBuf]) -> Result<(Vec<Member>, Studies), EvaluationError> {
    let (mut members, mut studies) = (Vec::new(), Vec::new());
    for (name, folder) in names(folders).into_iter().zip(folders) {
        if !is_study(folder) {
            members.push(Member { name, folder: folder.clone(), study: None });
            continue;
        }
        let results = StudyResults::read(folder)?;
        members.extend(results.study.members.iter().map(|member| Member {
            name: format!("{name}/{}", member.folder),
            folder: folder.join(&member.folder),
            study: Some((name.clone(), member.label.clone())),
        }));
        studies.push((name, results));
    }
    Ok((members, studies))
}

/// Returns the names of run folders, or their whole paths if the names alone are not unique.
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
