//! Read access to a finished run: its values, and the events and rollouts of any scenario.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use reactsim_formats::rollouts::{ByName, RolloutRecord};
use reactsim_scene::{Frame, Scenario};

use crate::error::EvaluationError;
use crate::folder::rollouts::{entered_in, recorded_tracks};
use crate::folder::{cannot_read, for_lines, read_summary, read_tally};
use crate::layout::REFERENCE_RECORD;
use crate::layout::{EVENTS, ROLLOUTS};
use crate::row::{EventHead, EventRecord, RecordPosition};
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// A finished run. Its values, event counts and file offsets are in memory; events and rollouts are read on
/// demand.
pub struct FinishedRun {
    folder: PathBuf,
    summary: Summary,
    tally: Tally,
    /// Event ranges by scenario and simulator.
    events: BTreeMap<(RecordPosition, usize), EventRange>,
    rollouts: Option<ByName>,
}

/// The contiguous bytes with the events of one scenario and one simulator.
#[derive(Default)]
struct EventRange {
    offset: u64,
    length: usize,
    /// Number of events that count, by metric, over all rollouts.
    counted: BTreeMap<String, u32>,
}

impl FinishedRun {
    /// Opens the folder of a finished run.
    ///
    /// # Errors
    /// [`EvaluationError`] if there is no run, it is not finished, or its files are damaged.
    pub fn open(folder: &Path) -> Result<Self, EvaluationError> {
        let summary = read_summary(folder)?;
        let tally = read_tally(folder)?;
        let mut events: BTreeMap<(RecordPosition, usize), EventRange> = BTreeMap::new();
        let path = folder.join(EVENTS);
        if !path.exists() && folder.join(REFERENCE_RECORD).exists() {
            let text = "is a reference, which has no events: use the folder of its run for pages";
            return Err(EvaluationError::Refused(format!("{} {text}", folder.display())));
        }
        let mut damaged = None;
        for_lines(&path, |at, text| {
            let line: EventHead = match serde_json::from_str(text) {
                Ok(line) => line,
                Err(error) => {
                    damaged.get_or_insert(error);
                    return;
                }
            };
            let Some(simulator) = tally.simulators.iter().position(|s| *s == line.simulator) else { return };
            let range = events.entry((line.place(), simulator)).or_default();
            if range.length == 0 {
                range.offset = at;
            }
            range.length = (at - range.offset) as usize + text.len();
            if line.counted {
                *range.counted.entry(line.metric).or_default() += 1;
            }
        })?;
        if let Some(source) = damaged {
            return Err(EvaluationError::Damaged { path, source });
        }
        let rollouts = folder.join(ROLLOUTS);
        let rollouts = if rollouts.exists() { Some(ByName::open(&rollouts)?) } else { None };
        Ok(Self { folder: folder.to_owned(), summary, tally, events, rollouts })
    }

    /// Returns the result of the run.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Returns the values of the run, by scenario.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Returns whether the run kept its rollouts.
    pub fn keeps_rollouts(&self) -> bool {
        self.rollouts.is_some()
    }

    /// Returns the number of events of a metric that count in a scenario with a simulator (an index into the
    /// tally's list), over all rollouts.
    pub fn counted(&self, place: RecordPosition, simulator: usize, metric: &str) -> u32 {
        let range = self.events.get(&(place, simulator));
        range.and_then(|r| r.counted.get(metric)).copied().unwrap_or(0)
    }

    /// Reads all events of a scenario with a simulator, of every rollout.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read any more.
    pub fn events(
        &self,
        place: RecordPosition,
        simulator: usize,
    ) -> Result<Vec<EventRecord>, EvaluationError> {
        let Some(range) = self.events.get(&(place, simulator)) else { return Ok(Vec::new()) };
        let path = self.folder.join(EVENTS);
        let mut bytes = vec![0; range.length];
        let mut read = || {
            let mut file = File::open(&path)?;
            file.seek(SeekFrom::Start(range.offset))?;
            file.read_exact(&mut bytes)
        };
        read().map_err(cannot_read(&path))?;
        let lines = bytes.split(|b| *b == b'\n').filter(|line| !line.is_empty());
        lines
            .map(|line| {
                serde_json::from_slice(line)
                    .map_err(|source| EvaluationError::Damaged { path: path.clone(), source })
            })
            .collect()
    }

    /// Reads the realised tracks of a rollout: the frames of each agent of the scenario. `None` if it was not
    /// kept.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read, or its rollout does not match the scenario.
    pub fn tracks(
        &self,
        scenario: &Scenario,
        simulator: usize,
        rollout: u32,
    ) -> Result<Option<Vec<Vec<Frame>>>, EvaluationError> {
        let Some(record) = self.recorded(&scenario.id, simulator, rollout)? else { return Ok(None) };
        let foreign = |error| {
            let (path, id) = (self.folder.join(ROLLOUTS), &scenario.id);
            EvaluationError::Refused(format!(
                "{}: the rollout of scenario `{id}` does not match it: {error}; make the run again",
                path.display()
            ))
        };
        recorded_tracks(scenario, &record).map(Some).map_err(foreign)
    }

    /// Returns the indices in [`Scenario::unselected`] of the agents that entered a rollout. With
    /// [`Scenario::with_entered`], [`Self::tracks`] returns their tracks as well. Empty if it was not kept.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read.
    pub fn entered(
        &self,
        scenario: &Scenario,
        simulator: usize,
        rollout: u32,
    ) -> Result<Vec<usize>, EvaluationError> {
        if self.summary.provenance.run.settings.entering.is_none() {
            return Ok(Vec::new());
        }
        let record = self.recorded(&scenario.id, simulator, rollout)?;
        Ok(record.map_or_else(Vec::new, |record| entered_in(scenario, &record)))
    }

    /// Reads a rollout as it was kept, by the id of its scenario. `None` if it was not kept.
    pub(crate) fn recorded(
        &self,
        scenario: &str,
        simulator: usize,
        rollout: u32,
    ) -> Result<Option<RolloutRecord>, EvaluationError> {
        let Some(rollouts) = &self.rollouts else { return Ok(None) };
        Ok(rollouts.read(scenario, &self.tally.simulators[simulator], rollout)?)
    }
}
