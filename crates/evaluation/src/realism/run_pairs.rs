//! The scenarios of a run with their logs.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use reactsim_files::name_of;
use reactsim_formats::{
    CurrentFrames, FormatError, Input, PendingScenarios, Scenarios,
    rollouts::{ByName, RolloutRecord},
    wosac::WosacLogs,
};
use reactsim_scene::{
    Scenario,
    wosac::{ObjectIds, WosacLog},
};
use reactsim_shards::RecordRange;

use super::run_rollouts::run_rollouts;
use super::scores::{RealismFailure, ScoredPair};
use crate::folder::{ROLLOUTS, read_summary};
use crate::{EvaluationError, FileRecord, Registrar, Source};

/// Format of recordings in the records of files.
const RECORDING: &str = "womd";

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

    /// Returns the record of the file, which is read for its digest.
    ///
    /// # Errors
    /// [`EvaluationError::Read`].
    pub fn record(&self) -> Result<FileRecord, EvaluationError> {
        match self {
            Self::Recording(path) => FileRecord::of(path, RECORDING),
            Self::Scenarios(input) => Registrar::default().record(input),
            Self::Shipped => Ok(Source::shipped(usize::MAX).file),
        }
    }

    /// Returns whether the file has the name of a record.
    pub fn is_named(&self, record: &FileRecord) -> bool {
        match self {
            Self::Recording(path) => name_of(path) == record.name,
            Self::Scenarios(input) => record.is_named(input),
            Self::Shipped => false,
        }
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
    sources: VecDeque<LogSource>,
    open: Option<Logs>,
    /// Number of logs that are passed over in the first source, and of those that are read.
    range: Option<(usize, usize)>,
    read: usize,
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
            Box::new(records.map(|record| record.and_then(|decode| decode())))
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
    /// [`EvaluationError`] if there is no finished run, it kept no rollouts, it lacks the simulator, or it
    /// has other current frames than recordings among the sources.
    pub fn open(
        folder: &Path,
        simulator: Option<&str>,
        sources: Vec<LogSource>,
    ) -> Result<Self, EvaluationError> {
        let summary = read_summary(folder)?;
        let is_elsewhere = |file: &FileRecord| file.frames() != CurrentFrames::Stated;
        let is_recorded = sources.iter().any(|source| matches!(source, LogSource::Recording(_)));
        if is_recorded && summary.provenance.run.inputs.iter().any(is_elsewhere) {
            return Err(EvaluationError::OtherCurrentFrames { path: folder.to_owned() });
        }
        let path = folder.join(ROLLOUTS);
        if !path.exists() {
            return Err(EvaluationError::NoRollouts { path: folder.to_owned() });
        }
        let ids: Vec<String> = summary.provenance.run.simulators.iter().map(|s| s.id.clone()).collect();
        let chosen = match (simulator, ids.as_slice()) {
            (Some(id), _) => ids.iter().find(|other| *other == id).cloned(),
            (None, [only]) => Some(only.clone()),
            (None, _) => None,
        };
        let Some(simulator) = chosen else {
            let asked = simulator.map(str::to_owned);
            return Err(EvaluationError::WhichSimulator { path: folder.to_owned(), asked, ids });
        };
        let records = ByName::open(&path)?;
        let rollouts = summary.provenance.run.settings.rollouts;
        let scenarios = summary.provenance.scenarios;
        let (folder, sources) = (folder.to_owned(), sources.into());
        Ok(Self {
            folder,
            simulator,
            rollouts,
            scenarios,
            records,
            sources,
            open: None,
            range: None,
            read: 0,
            missing: Vec::new(),
        })
    }

    /// Restricts the pairs to those of a range of logs.
    #[must_use]
    pub fn within(mut self, range: RecordRange) -> Self {
        self.sources = self.sources.into_iter().skip(range.input).take(1).collect();
        self.range = Some((range.first, range.count));
        self
    }

    /// Returns the number of logs that were read, damaged ones included.
    pub fn logs(&self) -> usize {
        self.read
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

    /// Returns the next log.
    fn next_log(&mut self) -> Option<Result<Logged, FormatError>> {
        let (first, count) = self.range.unwrap_or((0, usize::MAX));
        if self.read >= count {
            return None;
        }
        loop {
            let next = match &mut self.open {
                Some(Logs::Recorded(logs)) => logs.next().map(|log| log.map(Logged::recorded)),
                Some(Logs::Scenarios(scenarios)) => {
                    scenarios.next().map(|scenario| scenario.map(|scenario| Logged::of(&scenario)))
                }
                None => None,
            };
            if next.is_some() {
                self.read += 1;
                return next;
            }
            match Logs::open(self.sources.pop_front()?, first) {
                Ok(logs) => self.open = Some(logs),
                Err(error) => {
                    self.open = None;
                    self.read += 1;
                    return Some(Err(error));
                }
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

    fn of(scenario: &Scenario) -> Self {
        Self { log: WosacLog::of_scenario(scenario), ids: ObjectIds::of(scenario) }
    }
}

impl Iterator for RunPairs {
    type Item = Result<ScoredPair, RealismFailure>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let logged = match self.next_log()? {
                Ok(logged) => logged,
                Err(error) => {
                    return Some(Err(RealismFailure { scenario_id: None, error: error.to_string() }));
                }
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
