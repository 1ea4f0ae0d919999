//! The scenarios of a run with their logs.

use std::collections::VecDeque;
use std::ops::Range;
use std::path::{Path, PathBuf};

use reactsim_formats::{
    CurrentFrames, FormatError, Input, PendingScenarios, Scenarios, UndecodedScenario,
    rollouts::{ByName, RolloutRecord},
    wosac::WosacLogs,
};
use reactsim_scene::{
    Scenario,
    wosac::{ObjectIds, WosacLog},
};

use super::run_rollouts::run_rollouts;
use super::scores::{RealismFailure, ScoredPair};
use crate::error::EvaluationError;
use crate::folder::read_summary;
use crate::layout::ROLLOUTS;
use crate::source::Source;
use crate::source::file_record::FileRecord;

/// Files of logs.
#[derive(Clone)]
pub enum LogSource {
    /// A file of the Waymo Open Motion Dataset, from which logs are read as they were recorded.
    Recording(PathBuf),
    /// Scenarios of any format, whose logs lack what [`WosacLog::of_scenario`] says.
    Scenarios(Input),
    /// The scenarios that ship with the program.
    Shipped,
}

impl LogSource {
    /// Returns the source of the logs of a file as they were recorded, if it is a recording, else of its
    /// scenarios.
    pub fn of(input: Input) -> Self {
        if input.is_recording() { Self::Recording(input.path) } else { Self::Scenarios(input) }
    }

    /// Returns whether a file is, by its name, one `Scenario` message without framing, which is of no format that
    /// simulators read.
    pub fn is_message(path: &Path) -> bool {
        path.is_file() && path.to_string_lossy().contains(".binproto")
    }

    /// Returns the path of the file; `None` for the shipped scenarios.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::Recording(path) => Some(path),
            Self::Scenarios(input) => Some(&input.path),
            Self::Shipped => None,
        }
    }

    /// Returns the number of logs, damaged ones included. A source that cannot be opened has one, so that its
    /// error is reported.
    pub fn count(&self) -> usize {
        let counted = match self {
            Self::Recording(path) => {
                WosacLogs::open(path).map(|mut logs| std::iter::from_fn(|| logs.next_if(|_| false)).count())
            }
            Self::Scenarios(input) => input.open_undecoded().map(Iterator::count),
            Self::Shipped => (Source::shipped(usize::MAX).open)(0).map(Iterator::count),
        };
        counted.unwrap_or(1)
    }
}

/// Iterator over the scenarios of a run for one simulator: each log with the rollouts of the run, in the
/// order of the logs. Logs of scenarios that are not in the run are counted by [`Self::missing`].
pub struct RunPairs {
    folder: PathBuf,
    simulator: String,
    rollouts: u32,
    scenarios: usize,
    records: ByName,
    /// Sources that are not open yet, with the logs of each that are read.
    sources: VecDeque<(LogSource, Range<usize>)>,
    /// The open source, with the number of its logs that are left.
    open: Option<(Logs, usize)>,
    missing: Vec<String>,
}

enum Logs {
    Recorded(WosacLogs),
    Scenarios(Scenarios),
}

impl Logs {
    /// Opens a source and passes over its first logs.
    fn open(source: LogSource, first: usize) -> Result<Self, FormatError> {
        let scenarios = |records: PendingScenarios| -> Scenarios {
            Box::new(records.map(|record| record.and_then(UndecodedScenario::decode)))
        };
        Ok(match source {
            LogSource::Recording(path) => {
                let mut logs = WosacLogs::open(&path)?;
                logs.pass_over(first as u64);
                Self::Recorded(logs)
            }
            LogSource::Scenarios(input) => Self::Scenarios(scenarios(input.open_from(first)?)),
            LogSource::Shipped => Self::Scenarios(scenarios((Source::shipped(usize::MAX).open)(first)?)),
        })
    }
}

/// A log, and how agents of the run are found in it.
struct Logged {
    log: WosacLog,
    ids: ObjectIds,
}

impl RunPairs {
    /// Opens a run folder with kept rollouts. `simulator` may be absent if the run has only one.
    ///
    /// # Errors
    /// [`EvaluationError`] if there is no finished run, it kept no rollouts, agents entered it, it lacks the
    /// simulator, or it has other current frames than recordings among the sources.
    pub fn open(
        folder: &Path,
        simulator: Option<&str>,
        sources: Vec<LogSource>,
    ) -> Result<Self, EvaluationError> {
        let summary = read_summary(folder)?;
        let is_elsewhere =
            |file: &FileRecord| file.frames() != CurrentFrames::Stated || !file.length().is_default();
        let is_recorded = sources.iter().any(|source| matches!(source, LogSource::Recording(_)));
        if is_recorded && summary.provenance.run.inputs.iter().any(is_elsewhere) {
            return Err(EvaluationError::Refused(format!(
                "{} was run with `current-frame`, `window-step`, `history` or `future`, and recordings are \
                 scored at the current frame that they state, with 80 steps: run without these keys",
                folder.display()
            )));
        }
        if let Some(entering) = &summary.provenance.run.settings.entering {
            return Err(EvaluationError::Refused(format!(
                "{} was run with `entering` {entering}, and the Sim Agents challenge has the same agents at all \
                 steps: run with `entering` off",
                folder.display()
            )));
        }
        let path = folder.join(ROLLOUTS);
        if !path.exists() {
            let text = "has no rollouts: run again with `keep-rollouts`";
            return Err(EvaluationError::Refused(format!("{} {text}", folder.display())));
        }
        let ids: Vec<String> = summary.provenance.run.simulators.iter().map(|s| s.id.clone()).collect();
        let chosen = match (simulator, ids.as_slice()) {
            (Some(id), _) => ids.iter().find(|other| *other == id).cloned(),
            (None, [only]) => Some(only.clone()),
            (None, _) => None,
        };
        let Some(simulator) = chosen else {
            let (place, ids) = (folder.display(), ids.join(", "));
            let asked = simulator.map_or_else(String::new, |id| format!(", not `{id}`"));
            let text = format!("{place} has the simulators {ids}{asked}: choose one");
            return Err(EvaluationError::WhichSimulator(text));
        };
        let records = ByName::open(&path)?;
        let rollouts = summary.provenance.run.settings.rollouts;
        let scenarios = summary.provenance.scenarios;
        let (folder, all) = (folder.to_owned(), 0..usize::MAX);
        let sources = sources.into_iter().map(|source| (source, all.clone())).collect();
        Ok(Self { folder, simulator, rollouts, scenarios, records, sources, open: None, missing: Vec::new() })
    }

    /// Restricts the pairs to these logs of each source.
    #[must_use]
    pub fn within(mut self, ranges: Vec<Range<usize>>) -> Self {
        let sources = self.sources.into_iter().zip(ranges);
        self.sources = sources.map(|((source, _), range)| (source, range)).collect();
        self.sources.retain(|(_, range)| !range.is_empty());
        self
    }

    /// Returns the id of the simulator.
    pub fn simulator(&self) -> &str {
        &self.simulator
    }

    /// Returns the number of scenarios of the run.
    pub fn scenarios(&self) -> usize {
        self.scenarios
    }

    /// Returns the ids of the scenarios with a log that are not in the run, of those so far.
    pub fn missing(&self) -> &[String] {
        &self.missing
    }

    fn next_log(&mut self) -> Option<Result<Logged, RealismFailure>> {
        loop {
            if let Some((logs, left)) = self.open.as_mut().filter(|(_, left)| *left > 0) {
                *left -= 1;
                let next = match logs {
                    Logs::Recorded(logs) => logs.next().map(|log| Ok(Logged::recorded(log?))),
                    Logs::Scenarios(scenarios) => scenarios.next().map(|scenario| Logged::of(&scenario?)),
                };
                if next.is_some() {
                    return next;
                }
            }
            let (source, range) = self.sources.pop_front()?;
            self.open = None;
            match Logs::open(source, range.start) {
                Ok(logs) => self.open = Some((logs, range.len())),
                Err(error) => return Some(Err(error.into())),
            }
        }
    }

    fn records(&self, id: &str) -> Result<Vec<RolloutRecord>, FormatError> {
        let read = |rollout| self.records.read(id, &self.simulator, rollout).transpose();
        (0..self.rollouts).filter_map(read).collect()
    }

    fn pair(&self, logged: Logged, records: &[RolloutRecord]) -> Result<ScoredPair, RealismFailure> {
        let rollouts = run_rollouts(records, &logged.log, |id| logged.ids.get(id));
        let place = self.folder.display().to_string();
        match rollouts {
            Ok(rollouts) => Ok(ScoredPair { place, log: logged.log, rollouts }),
            Err(error) => Err(RealismFailure {
                scenario_id: Some(logged.log.scenario_id),
                error: format!("{place}: {error}"),
            }),
        }
    }
}

impl Logged {
    fn recorded(log: WosacLog) -> Self {
        Self { log, ids: ObjectIds::Own }
    }

    fn of(scenario: &Scenario) -> Result<Self, RealismFailure> {
        let log = WosacLog::of_scenario(scenario).map_err(|error| RealismFailure {
            scenario_id: Some(scenario.id.clone()),
            error: error.to_string(),
        })?;
        Ok(Self { log, ids: ObjectIds::of(scenario) })
    }
}

impl Iterator for RunPairs {
    type Item = Result<ScoredPair, RealismFailure>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let logged = match self.next_log()? {
                Ok(logged) => logged,
                Err(failure) => return Some(Err(failure)),
            };
            let id = logged.log.scenario_id.clone();
            match self.records(&id) {
                Ok(records) if records.is_empty() => self.missing.push(id),
                Ok(records) => return Some(self.pair(logged, &records)),
                Err(error) => {
                    return Some(Err(RealismFailure { scenario_id: Some(id), error: error.to_string() }));
                }
            }
        }
    }
}

impl From<FormatError> for RealismFailure {
    fn from(error: FormatError) -> Self {
        Self { scenario_id: None, error: error.to_string() }
    }
}
