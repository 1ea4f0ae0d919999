//! Finished runs beside each other, scenario by scenario.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::PageError;
use super::scene::{Performance, scene};
use crate::evaluation::{Archive, Place, Shelf, StudyResults};

/// A run that is to be shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// What it is called on the page.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// The study that it belongs to, and what it is there.
    pub study: Option<(String, String)>,
}

/// Finished runs with their scenarios.
pub struct Gallery {
    pub(super) runs: Vec<Shown>,
    pub(super) subjects: Vec<Subject>,
    pub(super) scenarios: Vec<Joined>,
    /// Studies by name; their runs are among those above.
    pub(super) studies: Vec<(String, StudyResults)>,
    shelf: Shelf,
}

/// A run.
pub(super) struct Shown {
    pub(super) name: String,
    pub(super) study: Option<(String, String)>,
    pub(super) archive: Archive,
}

/// A simulator of a run: what is compared.
pub(super) struct Subject {
    /// Number of its run.
    pub(super) run: usize,
    /// Its place in the tally's list.
    pub(super) simulator: usize,
    pub(super) id: String,
    pub(super) title: String,
    pub(super) oracle: bool,
}

/// A scenario of one or several runs.
pub(super) struct Joined {
    pub(super) id: String,
    pub(super) digest: String,
    pub(super) category: Option<String>,
    pub(super) difficulty: Option<String>,
    /// Its place in each run.
    pub(super) places: Vec<Option<Place>>,
}

impl Gallery {
    /// Opens runs, and takes the results of the studies that some of them belong to. A scenario of several runs is the same where id and
    /// digest are.
    ///
    /// # Errors
    /// [`PageError`] when a run can not be read or two have one name.
    pub fn open(
        members: Vec<Member>,
        studies: Vec<(String, StudyResults)>,
        shelf: Shelf,
    ) -> Result<Self, PageError> {
        let mut names = BTreeSet::new();
        let mut runs = Vec::with_capacity(members.len());
        for member in members {
            if !names.insert(member.name.clone()) {
                return Err(PageError::SameRun(member.name));
            }
            let archive = Archive::open(&member.folder)?;
            runs.push(Shown { name: member.name, study: member.study, archive });
        }
        let mut subjects = Vec::new();
        let mut scenarios: Vec<Joined> = Vec::new();
        let mut known: BTreeMap<(String, String), usize> = BTreeMap::new();
        for (number, run) in runs.iter().enumerate() {
            for record in &run.archive.summary().provenance.run.simulators {
                let tally = run.archive.tally();
                let Some(simulator) = tally.simulators.iter().position(|s| *s == record.id) else { continue };
                let (id, title) = (record.id.clone(), record.title.clone());
                subjects.push(Subject { run: number, simulator, id, title, oracle: record.oracle });
            }
            for (place, entry) in &run.archive.tally().entries {
                let key = (entry.scenario.clone(), entry.digest.clone());
                let at = *known.entry(key).or_insert_with(|| {
                    scenarios.push(Joined {
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
        Ok(Self { runs, subjects, scenarios, studies, shelf })
    }

    /// The number of a scenario by its id, the first where several have it.
    pub(super) fn find(&self, id: &str) -> Option<usize> {
        self.scenarios.iter().position(|s| s.id == id)
    }

    /// What lacks for scenes, in words for people: runs without rollouts, files of scenarios that were not given.
    pub fn lacks(&self) -> Vec<String> {
        let mut lacks = Vec::new();
        let bare = self.runs.iter().filter(|run| !run.archive.keeps_rollouts());
        let bare: Vec<String> = bare.map(|run| format!("`{}`", run.name)).collect();
        if !bare.is_empty() {
            let names = bare.join(", ");
            lacks.push(format!("no rollouts were kept of {names}: run with --keep-rollouts to see them"));
        }
        let inputs = self.runs.iter().flat_map(|r| &r.archive.summary().provenance.run.inputs);
        let missing: BTreeSet<&str> =
            inputs.filter(|file| !self.shelf.has(file)).map(|f| f.name.as_str()).collect();
        if !missing.is_empty() {
            let names: Vec<&str> = missing.into_iter().collect();
            lacks.push(format!(
                "the scenarios of {} are not at hand, so that nothing of them can be drawn: give --scenarios \
                 with the files of the run",
                names.join(", ")
            ));
        }
        lacks
    }

    /// Whether there is something to draw of a scenario.
    pub(super) fn has_scene(&self, index: usize) -> bool {
        self.runs.iter().zip(&self.scenarios[index].places).any(|(run, place)| {
            let inputs = &run.archive.summary().provenance.run.inputs;
            let file = place.and_then(|p| inputs.get(p.input));
            run.archive.keeps_rollouts() && file.is_some_and(|f| self.shelf.has(f))
        })
    }

    /// The JSON of a scene: the scenario with the first rollout of every subject. `None` where there is nothing to draw.
    pub(super) fn scene(&self, index: usize) -> Result<Option<String>, PageError> {
        let Some(joined) = self.scenarios.get(index) else { return Ok(None) };
        let mut scenario = None;
        for (run, place) in self.runs.iter().zip(&joined.places) {
            let inputs = &run.archive.summary().provenance.run.inputs;
            if let Some(place) = place
                && let Some(file) = inputs.get(place.input)
            {
                scenario = self.shelf.read(file, place.record, &joined.digest)?;
            }
            if scenario.is_some() {
                break;
            }
        }
        let Some(scenario) = scenario else { return Ok(None) };
        let mut performances = Vec::new();
        for (number, subject) in self.subjects.iter().enumerate() {
            let archive = &self.runs[subject.run].archive;
            let Some(place) = joined.places[subject.run] else { continue };
            if !archive.tally().has(place, subject.simulator) {
                continue;
            }
            let Some(tracks) = archive.tracks(&scenario, subject.simulator, 0)? else { continue };
            let mut events = archive.events(place, subject.simulator)?;
            events.retain(|event| event.rollout == 0);
            performances.push(Performance { subject: number, tracks, events });
        }
        if performances.is_empty() {
            return Ok(None);
        }
        Ok(Some(scene(&scenario, &performances)?))
    }
}
