//! Scenarios of a specification.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use reactsim_formats::{
    CurrentFrames, FutureChoice, Input, LengthChoice, Partition, PassedOver, deviations, nuplan_filter,
    survey,
};
use reactsim_scene::{Deviation, Length, Scenario};
use serde::{Deserialize, Serialize};

use crate::av::AvChoice;
use crate::error::EvaluationError;
use crate::source::file_record::current_frames;
use crate::source::selection::Selection;
use crate::source::{Source, limited, limited_shipped};

/// Scenarios, by default those of the shipped benchmark, and their deviated AVs.
#[derive(Clone, Debug, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct ScenarioSpec {
    /// Files, folders or URLs of scenarios [default: the shipped benchmark]
    #[arg(value_name = "SCENARIOS")]
    pub scenarios: Vec<PathBuf>,
    /// Deviated AVs by scenario id, Parquet or JSON, also a URL; other scenarios are skipped
    #[arg(long, value_name = "FILE")]
    pub deviations: Option<PathBuf>,
    /// Only the first N scenarios that are run, over all files [default: all]
    #[arg(long, value_name = "N")]
    pub limit: Option<NonZeroUsize>,
    /// Scenarios by id and category.
    #[command(flatten)]
    #[serde(flatten)]
    pub selection: SelectionSpec,
    /// Options for formats that leave a choice to the reader.
    #[command(flatten)]
    #[serde(flatten)]
    pub reading: ReadingSpec,
}

/// Scenarios by id and category.
#[derive(Clone, Debug, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct SelectionSpec {
    /// Only the scenario with this id; may be repeated
    #[arg(long, value_name = "ID")]
    pub id: Vec<String>,
    /// Only scenarios whose deviated AV has this category; may be repeated
    #[arg(long, value_name = "CATEGORY", value_delimiter = ',', value_parser = Deviation::ALL.map(Deviation::name))]
    pub category: Vec<String>,
}

/// Options for formats that leave a choice to the reader.
#[derive(Clone, Debug, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct ReadingSpec {
    /// Index of the current frame, from 0, for formats that leave it open (Argoverse 2, ScenarioNet, Waymo
    /// files of more than 91 frames) [default: the recorded index; for Argoverse 2 the latest one up to 49
    /// with 80 steps of the AV after it]
    #[arg(long, value_name = "N")]
    pub current_frame: Option<usize>,
    /// Several scenarios of each recording of Waymo files of 20 s, long ScenarioNet and native files: the
    /// first frame with enough history (frame 10) and every N frames after it is a current frame, as far as
    /// enough frames follow (80); ids get the frame, such as ID@60
    #[arg(long, value_name = "N")]
    pub window_step: Option<NonZeroUsize>,
    /// Frames up to and including the current one, 2 to 100; if the recorded one has fewer, it is the first
    /// that has them [default: 11; of native and JSON files, their own]
    #[arg(long, value_name = "N", value_parser = history)]
    pub history: Option<usize>,
    /// Frames after the current one: seconds (`15s`), steps of 0.1 s (`150`), at most 6000, or `log`, all
    /// that are recorded; scenarios with fewer fail [default: 80; of native and JSON files, their own]
    #[arg(long, value_name = "TIME")]
    pub future: Option<FutureChoice>,
    /// Simulate all agents that are present at the current frame, of all kinds and any number, as the Sim
    /// Agents challenge requires [default: the AV and the 63 nearest vehicles, pedestrians and cyclists]
    #[arg(long, num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
    pub all_agents: Option<bool>,
    /// Logs of nuPlan with a scenario filter.
    #[command(flatten)]
    #[serde(flatten)]
    pub nuplan: NuplanSpec,
}

/// Parses a number of frames up to and including the current one.
fn history(text: &str) -> Result<usize, String> {
    let valid = text.parse().ok().filter(|frames| (2..=Length::MAX_HISTORY).contains(frames));
    valid.ok_or_else(|| format!("expected 2 to {} frames", Length::MAX_HISTORY))
}

/// Logs of nuPlan with a scenario filter of the devkit.
#[derive(Clone, Debug, Default, PartialEq, Args, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case")]
pub struct NuplanSpec {
    /// Logs of nuPlan (`.db`), or folders that hold some; may be repeated
    #[arg(long, value_name = "LOGS")]
    pub nuplan: Vec<PathBuf>,
    /// Scenarios of --nuplan that a scenario_filter of nuPlan's devkit (YAML) selects, such as
    /// val14_split.yaml
    #[arg(long, value_name = "FILE")]
    pub filter: Option<PathBuf>,
    /// Folder with the list of nuPlan's maps [default: the one above the logs]
    #[arg(long, value_name = "FOLDER")]
    pub maps: Option<PathBuf>,
}

/// Which files are read for their digests when sources are opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opening {
    /// All.
    Whole,
    /// Those with records of a partition, which is run.
    Partition(Partition),
    /// None.
    Unread,
}

/// Says of a scenario whether it is run.
type IsRun = Box<dyn Fn(&Scenario) -> bool>;

impl ScenarioSpec {
    /// Returns whether the shipped scenarios are meant, because no others are given.
    pub fn is_shipped(&self) -> bool {
        self.reading.is_shipped(&self.scenarios)
    }

    /// Returns which scenarios are run with this AV policy, to count them towards the limit; `None` if all
    /// are, or without a limit.
    fn is_run(&self, av: Option<&AvChoice>) -> Result<Option<IsRun>, EvaluationError> {
        let selection = self.selection.selection();
        let file = match av {
            Some(AvChoice::File(path)) => Some(path.as_path()),
            _ => self.deviations.as_deref(),
        };
        let falls_back = matches!(av, Some(AvChoice::DeviatedOrLog));
        if self.limit.is_none() || !selection.leaves_out(file.is_some(), falls_back) {
            return Ok(None);
        }
        let deviations = file.map(deviations::read).transpose()?;
        Ok(Some(Box::new(move |scenario| selection.has(scenario, deviations.as_ref(), falls_back))))
    }

    /// Takes scenarios in memory in place of files, up to the limit of those that are run with this AV
    /// policy.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file of deviations is needed for the limit and cannot be read.
    pub fn in_memory(
        &self,
        scenarios: Vec<Scenario>,
        av: Option<&AvChoice>,
    ) -> Result<Source, EvaluationError> {
        let most = self.limit.map_or(usize::MAX, NonZeroUsize::get);
        Ok(Source::of_scenarios(scenarios, most, self.is_run(av)?.as_deref()))
    }

    /// Finds the files of scenarios and recognises their formats. The second value has the files that only
    /// look like scenarios.
    ///
    /// With a limit and a selection or a file of deviations, scenarios are decoded to count those that are
    /// run with this AV policy: one after the other, and not interruptibly, up to the last one.
    ///
    /// # Errors
    /// [`EvaluationError`] if a file cannot be read, or a key has no effect on the shipped scenarios.
    pub fn open(
        &self,
        opening: Opening,
        av: Option<&AvChoice>,
    ) -> Result<(Vec<Source>, PassedOver), EvaluationError> {
        let is_run = self.is_run(av)?;
        let (is_run, limit) = (is_run.as_deref(), self.limit.map(NonZeroUsize::get));
        if self.is_shipped() {
            self.reading.check_absent()?;
            return Ok((vec![limited_shipped(limit, is_run)?], PassedOver::new()));
        }
        let (inputs, passed_over) = self.reading.find_inputs(&self.scenarios)?;
        let inputs = limited(inputs, limit, is_run);
        let sources = match opening {
            Opening::Whole => Source::of_inputs(inputs)?,
            Opening::Partition(partition) => Source::of_partition(inputs, partition)?,
            Opening::Unread => Source::unread(inputs),
        };
        Ok((sources, passed_over))
    }
}

impl SelectionSpec {
    /// Returns the selection.
    pub fn selection(&self) -> Selection {
        let (ids, categories) = (&self.id, &self.category);
        Selection { ids: ids.iter().cloned().collect(), categories: categories.iter().cloned().collect() }
    }
}

impl From<Selection> for SelectionSpec {
    fn from(selection: Selection) -> Self {
        Self { id: selection.ids.into_iter().collect(), category: selection.categories.into_iter().collect() }
    }
}

impl ReadingSpec {
    /// Returns whether the shipped scenarios are meant, because no others are given.
    pub fn is_shipped(&self, paths: &[PathBuf]) -> bool {
        paths.is_empty() && self.nuplan.filter.is_none()
    }

    /// Returns whether all agents are simulated.
    pub fn has_all_agents(&self) -> bool {
        self.all_agents == Some(true)
    }

    /// Returns the current frames of recordings.
    pub fn frames(&self) -> CurrentFrames {
        current_frames(self.current_frame, self.window_step)
    }

    /// Returns the number of frames of scenarios.
    pub fn length(&self) -> LengthChoice {
        LengthChoice { history: self.history, future: self.future }
    }

    /// Returns whether recordings are read at the current frames and with the length that formats define.
    pub fn has_stated_frames(&self) -> bool {
        self.frames() == CurrentFrames::Stated && self.length().is_default()
    }

    /// Returns the keys that are given, with their values.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, String)> {
        let frame = self.current_frame.map(|frame| ("current-frame", frame.to_string()));
        let step = self.window_step.map(|step| ("window-step", step.to_string()));
        let history = self.history.map(|frames| ("history", frames.to_string()));
        let future = self.future.map(|future| ("future", future.to_string()));
        let all = self.has_all_agents().then(|| ("all-agents", true.to_string()));
        let filter = self.nuplan.filter.as_ref().map(|filter| ("filter", filter.display().to_string()));
        [frame, step, history, future, all, filter].into_iter().flatten()
    }

    /// Checks that the keys fit together.
    ///
    /// # Errors
    /// [`EvaluationError`] names two keys of which one is too many or too few, or a length that no scenario
    /// has.
    pub fn check(&self) -> Result<(), EvaluationError> {
        if self.current_frame.is_some() && self.window_step.is_some() {
            let text = "window-step and current-frame exclude each other: leave one of them out";
            return Err(EvaluationError::Refused(text.to_owned()));
        }
        let outside = |key, number: usize, least: usize, most: usize| {
            let refuse = || EvaluationError::spec(key, &number.to_string(), format!("{least} to {most}"));
            (number < least || number > most).then(refuse)
        };
        let history = self.history.and_then(|frames| outside("history", frames, 2, Length::MAX_HISTORY));
        let future = match self.future {
            Some(FutureChoice::Steps(steps)) => outside("future", steps, 1, Length::MAX_FUTURE),
            _ => None,
        };
        if let Some(error) = history.or(future) {
            return Err(error);
        }
        self.nuplan.check()
    }

    /// Refuses keys without effect on the shipped scenarios.
    ///
    /// # Errors
    /// [`EvaluationError`] as for [`Self::check`], and names the first key that is given.
    pub fn check_absent(&self) -> Result<(), EvaluationError> {
        self.check()?;
        match self.named().next() {
            Some((key, _)) => Err(EvaluationError::Refused(format!(
                "the shipped scenarios are read as they are: leave {key} out"
            ))),
            None => Ok(()),
        }
    }

    /// Finds the scenario files at all paths and in the logs of nuPlan, and sets how they are read. The
    /// second value has the files that only look like scenarios.
    ///
    /// # Errors
    /// [`EvaluationError`] as for [`Self::check`], and if a file cannot be read.
    pub fn find_inputs(&self, paths: &[PathBuf]) -> Result<(Vec<Input>, PassedOver), EvaluationError> {
        self.check()?;
        let (mut inputs, mut passed_over) = (Vec::new(), PassedOver::new());
        for path in paths {
            let found = survey(path)?;
            inputs.extend(found.inputs);
            passed_over.extend(found.passed_over);
        }
        inputs.extend(self.nuplan.input()?);
        for input in &mut inputs {
            (input.frames, input.length, input.all_agents) =
                (self.frames(), self.length(), self.has_all_agents());
        }
        Ok((inputs, passed_over))
    }
}

impl NuplanSpec {
    /// Checks that logs have a filter, and that the others have logs.
    ///
    /// # Errors
    /// [`EvaluationError`] names a key without effect and the one that is absent.
    pub fn check(&self) -> Result<(), EvaluationError> {
        let needs = |key, other| Err(EvaluationError::needs(key, other));
        match (self.nuplan.is_empty(), &self.filter, &self.maps) {
            (false, None, _) => needs("nuplan", "filter"),
            (true, Some(_), _) => needs("filter", "nuplan"),
            (true, None, Some(_)) => needs("maps", "nuplan"),
            _ => Ok(()),
        }
    }

    /// Returns the selected scenarios, if a filter is given.
    ///
    /// # Errors
    /// [`EvaluationError`] if one of the keys is absent, or the filter or a log cannot be read.
    pub fn input(&self) -> Result<Option<Input>, EvaluationError> {
        self.check()?;
        let Some(filter) = &self.filter else { return Ok(None) };
        Ok(Some(nuplan_filter(filter, &self.nuplan, self.maps.clone())?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_read_from_files_and_checked() {
        let read = |text: &str| serde_json::from_str::<ReadingSpec>(text);
        let given = read(r#"{"history": 21, "future": "15s"}"#).unwrap();
        let length = LengthChoice { history: Some(21), future: Some(FutureChoice::Steps(150)) };
        assert_eq!((given.length(), given.has_stated_frames()), (length, false));
        given.check().unwrap();
        let named: Vec<(&str, String)> = given.named().collect();
        assert_eq!(named, [("history", "21".to_owned()), ("future", "150".to_owned())]);
        assert_eq!(read(r#"{"future": 60}"#).unwrap().future, Some(FutureChoice::Steps(60)));
        assert!(read(r#"{"future": "soon"}"#).unwrap_err().to_string().contains("`soon` is no future"));
        let error = read(r#"{"history": 101}"#).unwrap().check().unwrap_err().to_string();
        assert_eq!(error, "history `101`: write 2 to 100");
        assert!(ReadingSpec::default().has_stated_frames());
    }

    #[test]
    fn a_limit_counts_the_scenarios_that_are_run_with_the_av() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("deviations.json");
        let record = |id: &str, category: &str| {
            let zeros = vec![0.0; 80];
            serde_json::json!({
                "scenario_id": id, "category": category, "x": zeros, "y": zeros, "heading": zeros
            })
        };
        let records = [record("crosswalk", "lateral"), record("left-turn-across", "directional")];
        let all = serde_json::json!({
            "format": "reactsim-deviations-v1", "frame": "scenario", "deviations": records
        });
        std::fs::write(&file, all.to_string()).unwrap();
        // One scenario per file: crossing, crosswalk, cut-in, left-turn-across and more.
        let mini = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenarios/mini"));
        let read = |deviations: Option<&PathBuf>, av: Option<&AvChoice>, most, id: &str, category: &str| {
            let given = |text: &str| -> Vec<String> {
                Some(text.to_owned()).into_iter().filter(|text| !text.is_empty()).collect()
            };
            let spec = ScenarioSpec {
                scenarios: vec![mini.clone()],
                deviations: deviations.cloned(),
                limit: NonZeroUsize::new(most),
                selection: SelectionSpec { id: given(id), category: given(category) },
                ..ScenarioSpec::default()
            };
            let sources = spec.open(Opening::Unread, av).unwrap().0;
            let scenarios = sources.iter().flat_map(|source| source.scenarios().unwrap());
            let in_memory = spec.in_memory(scenarios.map(Result::unwrap).collect(), av).unwrap();
            assert_eq!(in_memory.count, Some(sources.len()));
            sources.len()
        };
        let (deviated, own) = (AvChoice::Deviated, AvChoice::File(file.clone()));
        let or_log = AvChoice::DeviatedOrLog;
        let (file, or_log) = (Some(&file), Some(&or_log));
        assert_eq!(read(None, None, 2, "", ""), 2);
        // Others than these two are skipped.
        for (file, av) in [(file, None), (file, Some(&deviated)), (None, Some(&own))] {
            assert_eq!([1, 2].map(|most| read(file, av, most, "", "")), [2, 4], "{av:?}");
            assert_eq!(read(file, av, 1, "", "directional"), 4, "{av:?}");
        }
        // Others are run with the logged AV, which has no category.
        assert_eq!([1, 3].map(|most| read(file, or_log, most, "", "")), [1, 3]);
        assert_eq!(read(file, or_log, 1, "cut-in", ""), 3);
        assert_eq!(read(file, or_log, 1, "", "directional"), 4);
    }

    #[test]
    fn a_limit_of_scenarios_in_memory_counts_those_that_are_run() {
        let scenarios: Vec<Scenario> = Source::shipped(9).scenarios().unwrap().map(Result::unwrap).collect();
        let selection = SelectionSpec { id: vec![scenarios[6].id.clone()], category: Vec::new() };
        let spec = ScenarioSpec { limit: NonZeroUsize::new(1), selection, ..ScenarioSpec::default() };
        let source = spec.in_memory(scenarios.clone(), None).unwrap();
        let ids: Vec<String> = source.scenarios().unwrap().map(|scenario| scenario.unwrap().id).collect();
        let expected: Vec<&String> = scenarios[..7].iter().map(|scenario| &scenario.id).collect();
        assert_eq!((ids.iter().collect(), source.count), (expected, Some(7)));
        let all = ScenarioSpec::default().in_memory(scenarios, None).unwrap();
        assert_eq!(all.count, Some(9));
    }
}
