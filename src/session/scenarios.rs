//! The scenarios that requests name.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt::{self, Display};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

use serde::Deserialize;

use super::wire::{RequestError, refused};
use crate::evaluation::{Deviations, Selection, Source, limited};
use crate::formats::{
    self as formats, CurrentFrames, FutureChoice, LengthChoice, PendingScenarios, UndecodedScenario,
};
use crate::scene::Scenario;

/// Number of scenarios that are kept in memory.
const MOST_SCENARIOS: usize = 256;

/// Files of scenarios and how they are read.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Reading {
    /// Files, folders or URLs; none for the shipped benchmark.
    paths: Vec<PathBuf>,
    /// Index of the current frame, for formats that leave it open.
    current_frame: Option<usize>,
    /// Frames between the scenarios of one recording.
    window_step: Option<NonZeroUsize>,
    /// Frames up to and including the current one.
    #[serde(default)]
    history: Option<usize>,
    /// Frames after the current one.
    #[serde(default)]
    future: Option<FutureChoice>,
    /// Whether all agents are read.
    #[serde(default)]
    all_agents: bool,
    /// File of deviated AVs, in place of those that the scenarios carry.
    #[serde(default)]
    deviations: Option<PathBuf>,
}

impl Reading {
    /// Opens the files.
    ///
    /// # Errors
    /// If a file cannot be read, or both kinds of current frames are given.
    pub(super) fn sources(&self) -> Result<Vec<Source>, RequestError> {
        if self.paths.is_empty() {
            let given = [
                (self.current_frame.is_some(), "`current_frame`", "have a fixed current frame"),
                (self.window_step.is_some(), "`window_step`", "have one window each"),
                (self.history.is_some(), "`history`", "have a fixed length"),
                (self.future.is_some(), "`future`", "have a fixed length"),
                (self.all_agents, "`all_agents`", "have all their agents"),
            ];
            return match given.into_iter().find(|(is_given, ..)| *is_given) {
                Some((_, name, reason)) => {
                    refused(format_args!("the shipped scenarios {reason}: leave {name} out"))
                }
                None => Ok(vec![Source::shipped(usize::MAX)]),
            };
        }
        let frames = match (self.current_frame, self.window_step) {
            (Some(_), Some(_)) => {
                return refused("`current_frame` and `window_step` exclude each other");
            }
            (Some(frame), None) => CurrentFrames::At(frame),
            (None, Some(step)) => CurrentFrames::Every(step),
            (None, None) => CurrentFrames::Stated,
        };
        let length = LengthChoice { history: self.history, future: self.future };
        let mut inputs = Vec::new();
        for path in &self.paths {
            inputs.extend(formats::survey(path)?.inputs);
        }
        for input in &mut inputs {
            (input.frames, input.length, input.all_agents) = (frames, length, self.all_agents);
        }
        Ok(Source::of_inputs(limited(inputs, None, None))?)
    }

    /// Reads the scenarios with these ids, or all without ids, at most `limit`. Scenarios that cannot be
    /// read, such as logs that are shorter than requested, are skipped, unless their ids are given.
    ///
    /// # Errors
    /// If a scenario of these ids cannot be read, there are fewer than `limit` and an id is missing, or no
    /// scenario is left.
    pub(super) fn select(
        &self,
        ids: &BTreeSet<String>,
        limit: Option<usize>,
    ) -> Result<Selected, RequestError> {
        let selection = Selection { ids: ids.clone(), ..Selection::default() };
        let mut selected = Selected::default();
        let most = limit.unwrap_or(usize::MAX);
        for source in self.sources()? {
            if selected.scenarios.len() == most {
                break;
            }
            let scenarios = match source.scenarios() {
                Ok(scenarios) => scenarios,
                Err(error) => {
                    selected.skip(error);
                    continue;
                }
            };
            for scenario in scenarios {
                match scenario {
                    Ok(scenario) if selection.has_id(&scenario.id) => {
                        selected.scenarios.push(Arc::new(scenario));
                    }
                    Ok(_) => {}
                    Err(error) if error.scenario.as_ref().is_some_and(|id| ids.contains(id)) => {
                        return Err(error.into());
                    }
                    // Of which scenario it is, is not known, or ids need not be given.
                    Err(error) if ids.is_empty() || error.scenario.is_none() => selected.skip(error),
                    Err(_) => {}
                }
                if selected.scenarios.len() == most {
                    break;
                }
            }
        }
        let Selected { scenarios, skipped } = &selected;
        let reason = skipped.as_ref().map_or_else(String::new, |skipped| format!("; {skipped}"));
        let found = |id: &&String| scenarios.iter().any(|scenario| scenario.id == **id);
        let missing = ids.iter().find(|id| !found(id)).filter(|_| scenarios.len() < most);
        match (missing, scenarios.is_empty()) {
            (Some(id), _) => refused(format_args!("there is no scenario `{id}`{reason}")),
            (None, true) => refused(format_args!(
                "no scenario is selected: give files, ids or a limit that select some{reason}"
            )),
            (None, false) => Ok(selected),
        }
    }
}

/// Scenarios of a request.
#[derive(Default)]
pub(super) struct Selected {
    pub(super) scenarios: Vec<Arc<Scenario>>,
    pub(super) skipped: Option<Skipped>,
}

/// Scenarios and files that cannot be read.
pub(super) struct Skipped {
    count: usize,
    /// The error of the first one.
    first: String,
}

impl Selected {
    fn skip(&mut self, error: impl Display) {
        let skipped = self.skipped.get_or_insert_with(|| Skipped { count: 0, first: error.to_string() });
        skipped.count += 1;
    }
}

impl Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} skipped, the first: {}", self.count, self.first)
    }
}

/// A scenario with its digest.
pub(super) struct KnownScenario {
    pub(super) scenario: Scenario,
    pub(super) digest: String,
}

/// Scenarios by id, read when they are first named.
#[derive(Default)]
pub(super) struct ScenarioCache {
    files: BTreeMap<Reading, Files>,
    kept: VecDeque<(Reading, Arc<KnownScenario>)>,
}

impl ScenarioCache {
    /// Returns the scenario with this id.
    ///
    /// # Errors
    /// If a file cannot be opened, or no scenario has the id.
    pub(super) fn find(&mut self, reading: &Reading, id: &str) -> Result<Arc<KnownScenario>, RequestError> {
        let is_wanted =
            |(of, known): &&(Reading, Arc<KnownScenario>)| known.scenario.id == id && of == reading;
        if let Some((_, known)) = self.kept.iter().find(is_wanted) {
            return Ok(Arc::clone(known));
        }
        if !self.files.contains_key(reading) {
            self.files.insert(reading.clone(), Files::new(reading)?);
        }
        let missing =
            || RequestError::new(format_args!("no scenario `{id}` in {}", describe(&reading.paths)));
        let files = self.files.get_mut(reading).ok_or_else(missing)?;
        let mut scenario = files.find(id)?.ok_or_else(missing)?;
        let digest = scenario.digest();
        if let Some(deviations) = &files.deviations {
            let deviated = deviations.of(&scenario);
            let named = |error| RequestError::new(format_args!("scenario `{id}`: {error}"));
            scenario.deviation = Some(deviated.map_err(named)?);
        }
        let known = Arc::new(KnownScenario { digest, scenario });
        self.kept.push_back((reading.clone(), Arc::clone(&known)));
        if self.kept.len() > MOST_SCENARIOS {
            self.kept.pop_front();
        }
        Ok(known)
    }
}

/// Returns the names of files for messages.
pub(super) fn describe(paths: &[PathBuf]) -> String {
    let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    if names.is_empty() { "the shipped benchmark".to_owned() } else { names.join(", ") }
}

/// Files that are read in a circle: scenarios that are named in their order are found without reading any of
/// them twice.
struct Files {
    sources: Vec<Source>,
    /// Index of the source that is being read.
    index: usize,
    open: Option<PendingScenarios>,
    deviations: Option<Deviations>,
}

impl Files {
    fn new(reading: &Reading) -> Result<Self, RequestError> {
        let deviations = reading.deviations.as_deref().map(Deviations::read).transpose()?;
        Ok(Self { sources: reading.sources()?, index: 0, open: None, deviations })
    }

    fn find(&mut self, id: &str) -> Result<Option<Scenario>, RequestError> {
        // The rest of the files, then all of them.
        for _ in 0..2 {
            while let Some(scenario) = self.next()? {
                if scenario.id == id {
                    return Ok(Some(scenario));
                }
            }
        }
        Ok(None)
    }

    /// Returns the next scenario that can be read; `None` at the end, after which the first one follows.
    fn next(&mut self) -> Result<Option<Scenario>, RequestError> {
        while let Some(source) = self.sources.get(self.index) {
            let open = match &mut self.open {
                Some(open) => open,
                None => self.open.insert((source.open)(0)?),
            };
            for record in open {
                if let Ok(scenario) = record.and_then(UndecodedScenario::decode) {
                    return Ok(Some(scenario));
                }
            }
            (self.index, self.open) = (self.index + 1, None);
        }
        self.index = 0;
        Ok(None)
    }
}

/// Returns a scenario with this number of steps; the last states are repeated.
#[cfg(test)]
pub(super) fn of_length(scenario: &Scenario, steps: usize) -> Scenario {
    fn resized<T: Copy>(values: &mut Vec<T>, count: usize) {
        if let Some(last) = values.last().copied() {
            values.resize(count, last);
        }
    }
    let mut changed = scenario.clone();
    let frames = changed.start.current() + 1 + steps;
    changed.log_future.tracks.iter_mut().for_each(|track| resized(track, steps));
    changed.log_future.heights.iter_mut().for_each(|heights| resized(heights, steps));
    changed.log_future.lights.iter_mut().for_each(|states| resized(states, steps));
    for agent in &mut changed.unselected {
        resized(&mut agent.track, frames);
        resized(&mut agent.heights, frames);
    }
    if let Some(deviation) = &mut changed.deviation {
        resized(&mut deviation.track, steps);
        deviation.certificate = None;
    }
    changed.timestamps.clear();
    changed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_beyond_the_limit_are_not_missing() {
        let shipped = Source::shipped(2).scenarios().unwrap().map(|scenario| scenario.unwrap().id);
        let shipped: Vec<String> = shipped.collect();
        let select = |ids: &[&str], limit: Option<usize>| {
            let ids = ids.iter().map(|id| (*id).to_owned()).collect();
            let selected = Reading::default().select(&ids, limit);
            selected.map(|all| all.scenarios.iter().map(|scenario| scenario.id.clone()).collect::<Vec<_>>())
        };
        let both = [shipped[0].as_str(), shipped[1].as_str()];
        assert_eq!(select(&both, Some(1)).unwrap(), shipped[..1]);
        assert_eq!(select(&both, Some(2)).unwrap(), shipped);
        let missing = [both[0], "nowhere"];
        assert_eq!(select(&missing, Some(1)).unwrap(), shipped[..1]);
        for limit in [Some(2), None] {
            let refused = select(&missing, limit).unwrap_err();
            assert!(refused.to_string().contains("there is no scenario `nowhere`"));
        }
    }

    #[test]
    fn scenarios_that_cannot_be_read_are_skipped_unless_they_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let shipped: Vec<_> = Source::shipped(3).scenarios().unwrap().map(Result::unwrap).collect();
        let path = folder.path().join("a.parquet");
        let mut writer = formats::native::Writer::create(&path).unwrap();
        writer.write(&of_length(&shipped[0], 60)).unwrap();
        writer.write(&shipped[1]).unwrap();
        writer.write(&of_length(&shipped[2], 70)).unwrap();
        writer.finish().unwrap();
        let select = |future: usize, ids: &[&String]| {
            let future = Some(FutureChoice::Steps(future));
            let reading = Reading { paths: vec![path.clone()], future, ..Reading::default() };
            reading.select(&ids.iter().map(|id| (*id).clone()).collect(), None)
        };
        let text = |selected: Result<Selected, RequestError>| match selected {
            Ok(Selected { scenarios, skipped }) => {
                let ids: Vec<&str> = scenarios.iter().map(|scenario| scenario.id.as_str()).collect();
                (ids.join(" "), skipped.map(|skipped| skipped.to_string()).unwrap_or_default())
            }
            Err(error) => (String::new(), error.to_string()),
        };
        let [first, second, third] = [0, 1, 2].map(|k| &shipped[k].id);
        let (ids, skipped) = text(select(80, &[]));
        assert_eq!(ids, *second);
        let expected = format!("2 skipped, the first: {}: record 0: scenario `{first}`: ", path.display());
        assert!(skipped.starts_with(&expected), "{skipped}");
        assert_eq!(text(select(80, &[second])), (second.clone(), String::new()));
        let (_, refused) = text(select(80, &[second, third]));
        assert!(refused.contains(&format!("scenario `{third}`: the number of frames")), "{refused}");
        let (_, refused) = text(select(90, &[]));
        assert!(refused.contains("no scenario is selected") && refused.contains("3 skipped"), "{refused}");
    }
}
