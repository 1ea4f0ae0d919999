//! Finished runs side by side, matched by scenario.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use reactsim_evaluation::{
    EvaluationError, FinishedRun, RecordPosition, ScenarioFiles, StudyResults, TableMarks, is_study,
};
use reactsim_formats::Input;

use super::PageError;
use super::scene::{SubjectRollout, scene};

/// A run to show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Name on the page.
    pub name: String,
    /// Run folder.
    pub folder: PathBuf,
    /// Name of its study, and its label there.
    pub study: Option<(String, String)>,
}

/// Finished runs with their scenarios.
pub struct Gallery {
    pub(super) runs: Vec<GalleryRun>,
    pub(super) subjects: Vec<Subject>,
    pub(super) scenarios: Vec<GalleryScenario>,
    /// Studies with their names; their runs are among `runs`.
    pub(super) studies: Vec<(String, StudyResults)>,
    scenario_files: ScenarioFiles,
}

/// An opened run.
pub(super) struct GalleryRun {
    pub(super) name: String,
    pub(super) study: Option<(String, String)>,
    pub(super) finished: FinishedRun,
}

/// A simulator of a run, the unit of comparison.
pub(super) struct Subject {
    /// Index of its run.
    pub(super) run: usize,
    /// Its index in the tally's list of simulators.
    pub(super) simulator: usize,
    pub(super) id: String,
    pub(super) title: String,
    pub(super) marks: TableMarks,
}

/// A scenario of one or several runs.
pub(super) struct GalleryScenario {
    pub(super) id: String,
    pub(super) digest: String,
    pub(super) category: Option<String>,
    pub(super) difficulty: Option<String>,
    /// Its place in each run.
    pub(super) places: Vec<Option<RecordPosition>>,
}

impl Gallery {
    /// Opens the runs in these folders, members of studies included, with the given scenarios and those that
    /// [`ScenarioFiles::of_runs`] finds.
    ///
    /// # Errors
    /// [`PageError`] if a run or a given file cannot be read, or a folder is given twice.
    pub fn of_folders(folders: &[PathBuf], given: &[Input]) -> Result<Self, PageError> {
        let (members, studies) = members(folders)?;
        let folders: Vec<&Path> = members.iter().map(|member| member.folder.as_path()).collect();
        let scenario_files = ScenarioFiles::of_runs(&folders, given)?;
        Self::open(members, studies, scenario_files)
    }

    /// Opens runs, with the results of the studies that some of them belong to. Scenarios of different
    /// runs are identified by id and digest.
    ///
    /// # Errors
    /// [`PageError`] if a run cannot be read or two have the same name.
    pub fn open(
        members: Vec<Member>,
        studies: Vec<(String, StudyResults)>,
        scenario_files: ScenarioFiles,
    ) -> Result<Self, PageError> {
        let mut names = BTreeSet::new();
        let mut runs = Vec::with_capacity(members.len());
        for member in members {
            if !names.insert(member.name.clone()) {
                let text = format!("two runs are named `{}`: give each once", member.name);
                return Err(PageError::Refused(text));
            }
            let finished = FinishedRun::open(&member.folder)?;
            runs.push(GalleryRun { name: member.name, study: member.study, finished });
        }
        let mut subjects = Vec::new();
        let mut scenarios: Vec<GalleryScenario> = Vec::new();
        let mut known: BTreeMap<(String, String), usize> = BTreeMap::new();
        for (number, run) in runs.iter().enumerate() {
            for record in &run.finished.summary().provenance.run.simulators {
                let tally = run.finished.tally();
                let Some(simulator) = tally.simulators.iter().position(|s| *s == record.id) else { continue };
                let (id, title) = (record.id.clone(), record.title.clone());
                let summary = run.finished.summary().simulators.get(&record.id);
                let is_allowed = summary.is_some_and(|s| s.marks().is_allowed);
                let marks = TableMarks { access: record.access(), is_allowed };
                subjects.push(Subject { run: number, simulator, id, title, marks });
            }
            for (place, entry) in &run.finished.tally().entries {
                let key = (entry.scenario.clone(), entry.digest.clone());
                let at = *known.entry(key).or_insert_with(|| {
                    scenarios.push(GalleryScenario {
                        id: entry.scenario.clone(),
                        digest: entry.digest.clone(),
                        category: None,
                        difficulty: None,
                        places: vec![None; runs.len()],
                    });
                    scenarios.len() - 1
                });
                scenarios[at].places[number] = Some(*place);
                if scenarios[at].category.is_none() {
                    scenarios[at].category.clone_from(&entry.category);
                }
                if scenarios[at].difficulty.is_none() {
                    scenarios[at].difficulty.clone_from(&entry.difficulty);
                }
            }
        }
        Ok(Self { runs, subjects, scenarios, studies, scenario_files })
    }

    /// Returns the number of the first scenario with this id.
    pub(super) fn find(&self, id: &str) -> Option<usize> {
        self.scenarios.iter().position(|s| s.id == id)
    }

    /// Returns messages on why scenes are unavailable: runs without rollouts, missing files of scenarios.
    pub fn missing_for_scenes(&self) -> Vec<String> {
        let mut messages = Vec::new();
        let bare = self.runs.iter().filter(|run| !run.finished.keeps_rollouts());
        let bare: Vec<String> = bare.map(|run| format!("`{}`", run.name)).collect();
        if !bare.is_empty() {
            let names = bare.join(", ");
            messages.push(format!("no rollouts were kept of {names}: run with `keep-rollouts` to see them"));
        }
        let inputs = self.runs.iter().flat_map(|r| &r.finished.summary().provenance.run.inputs);
        let missing: BTreeSet<&str> =
            inputs.filter(|file| !self.scenario_files.has(file)).map(|f| f.name.as_str()).collect();
        if !missing.is_empty() {
            let names: Vec<&str> = missing.into_iter().collect();
            messages.push(format!(
                "the scenarios of {} are missing, so their scenes cannot be drawn: give \
                 the files of the run as `scenarios`",
                names.join(", ")
            ));
        }
        messages
    }

    pub(super) fn has_scene(&self, index: usize) -> bool {
        self.runs.iter().zip(&self.scenarios[index].places).any(|(run, place)| {
            let inputs = &run.finished.summary().provenance.run.inputs;
            let file = place.and_then(|p| inputs.get(p.input));
            run.finished.keeps_rollouts() && file.is_some_and(|f| self.scenario_files.has(f))
        })
    }

    /// Returns the JSON of a scene: the scenario with the first rollout of every subject. `None` if there
    /// is nothing to draw.
    pub(super) fn scene(&self, index: usize) -> Result<Option<String>, PageError> {
        let Some(wanted) = self.scenarios.get(index) else { return Ok(None) };
        let mut scenario = None;
        for (run, place) in self.runs.iter().zip(&wanted.places) {
            let inputs = &run.finished.summary().provenance.run.inputs;
            if let Some(place) = place
                && let Some(file) = inputs.get(place.input)
            {
                scenario = self.scenario_files.read(file, place.record, &wanted.digest)?;
            }
            if scenario.is_some() {
                break;
            }
        }
        let Some(mut scenario) = scenario else { return Ok(None) };
        let (mut entered, mut enters) = (BTreeSet::new(), false);
        for subject in &self.subjects {
            let finished = &self.runs[subject.run].finished;
            enters |= finished.summary().provenance.run.settings.entering.is_some();
            entered.extend(finished.entered(&scenario, subject.simulator, 0)?);
        }
        if enters {
            scenario = scenario.with_entered(&entered.into_iter().collect::<Vec<_>>());
        }
        let mut rollouts = Vec::new();
        for (number, subject) in self.subjects.iter().enumerate() {
            let finished = &self.runs[subject.run].finished;
            let Some(place) = wanted.places[subject.run] else { continue };
            if !finished.tally().has(place, subject.simulator) {
                continue;
            }
            let Some(tracks) = finished.tracks(&scenario, subject.simulator, 0)? else { continue };
            let mut events = finished.events(place, subject.simulator)?;
            events.retain(|event| event.rollout == 0);
            rollouts.push(SubjectRollout { subject: number, tracks, events });
        }
        if rollouts.is_empty() {
            return Ok(None);
        }
        Ok(Some(scene(&scenario, &rollouts)?))
    }
}

/// Studies with their names.
type Studies = Vec<(String, StudyResults)>;

/// Returns the runs in these folders, and the studies that some of them belong to.
///
/// # Errors
/// [`EvaluationError`] if a study cannot be read.
pub fn members(folders: &[PathBuf]) -> Result<(Vec<Member>, Studies), EvaluationError> {
    let (mut members, mut studies) = (Vec::new(), Vec::new());
    for (name, folder) in folder_names(folders).into_iter().zip(folders) {
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
pub fn folder_names(runs: &[PathBuf]) -> Vec<String> {
    let short: Vec<String> = runs
        .iter()
        .map(|p| p.file_name().map_or_else(|| p.display().to_string(), |n| n.to_string_lossy().into_owned()))
        .collect();
    let mut sorted = short.clone();
    sorted.sort();
    sorted.dedup();
    if sorted.len() == short.len() { short } else { runs.iter().map(|p| p.display().to_string()).collect() }
}
