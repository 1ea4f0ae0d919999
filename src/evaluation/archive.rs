//! A finished run to be looked at: its values, and events and rollouts of any scenario.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::EvaluationError;
use super::folder::{EVENTS, ROLLOUTS, cannot_read, for_lines, read_summary, read_tally};
use super::reference::REFERENCE_RECORD;
use super::rollouts::recorded_tracks;
use super::row::{EventRecord, Place};
use super::summary::Summary;
use super::tally::Tally;
use crate::formats::rollouts::ByName;
use crate::scene::{Frame, Scenario};

/// A finished run. In memory are its values, how many events there are, and where the rest lies.
pub struct Archive {
    folder: PathBuf,
    summary: Summary,
    tally: Tally,
    /// By scenario and simulator.
    events: BTreeMap<(Place, usize), Stretch>,
    rollouts: Option<ByName>,
}

/// The events of a pair of scenario and simulator, which lie together.
#[derive(Default)]
struct Stretch {
    at: u64,
    length: usize,
    /// Events that count, by metric, in all rollouts.
    counted: BTreeMap<String, u32>,
}

#[derive(Deserialize)]
struct LineHead {
    input: usize,
    record: usize,
    simulator: String,
    metric: String,
    counted: bool,
}

impl Archive {
    /// Opens the folder of a finished run.
    ///
    /// # Errors
    /// [`EvaluationError`] when there is no run, it is not finished, or its files are damaged.
    pub fn open(folder: &Path) -> Result<Self, EvaluationError> {
        let summary = read_summary(folder)?;
        let tally = read_tally(folder)?;
        let mut events: BTreeMap<(Place, usize), Stretch> = BTreeMap::new();
        let path = folder.join(EVENTS);
        if !path.exists() && folder.join(REFERENCE_RECORD).exists() {
            return Err(EvaluationError::NoEvents { path: folder.to_owned() });
        }
        let mut damaged = None;
        for_lines(&path, |at, text| {
            let head: LineHead = match serde_json::from_str(text) {
                Ok(head) => head,
                Err(error) => {
                    damaged.get_or_insert(error);
                    return;
                }
            };
            let Some(simulator) = tally.simulators.iter().position(|s| *s == head.simulator) else { return };
            let place = Place { input: head.input, record: head.record };
            let stretch = events.entry((place, simulator)).or_default();
            if stretch.length == 0 {
                stretch.at = at;
            }
            stretch.length = (at - stretch.at) as usize + text.len();
            if head.counted {
                *stretch.counted.entry(head.metric).or_default() += 1;
            }
        })?;
        if let Some(source) = damaged {
            return Err(EvaluationError::Damaged { path, source });
        }
        let rollouts = folder.join(ROLLOUTS);
        let rollouts = if rollouts.exists() { Some(ByName::open(&rollouts)?) } else { None };
        Ok(Self { folder: folder.to_owned(), summary, tally, events, rollouts })
    }

    /// Its result.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Its values by scenario.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Whether its rollouts were kept.
    pub fn keeps_rollouts(&self) -> bool {
        self.rollouts.is_some()
    }

    /// How many events of a metric count in a scenario with a simulator (a place in the tally's list), in all rollouts.
    pub fn counted(&self, place: Place, simulator: usize, metric: &str) -> u32 {
        let stretch = self.events.get(&(place, simulator));
        stretch.and_then(|s| s.counted.get(metric)).copied().unwrap_or(0)
    }

    /// All events of a scenario with a simulator, of every rollout.
    ///
    /// # Errors
    /// [`EvaluationError`] when the file can not be read any more.
    pub fn events(&self, place: Place, simulator: usize) -> Result<Vec<EventRecord>, EvaluationError> {
        let Some(stretch) = self.events.get(&(place, simulator)) else { return Ok(Vec::new()) };
        let path = self.folder.join(EVENTS);
        let mut bytes = vec![0; stretch.length];
        let mut read = || {
            let mut file = File::open(&path)?;
            file.seek(SeekFrom::Start(stretch.at))?;
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

    /// The realised tracks of a rollout: per agent of the scenario 91 frames. `None` where rollouts were not kept.
    ///
    /// # Errors
    /// [`EvaluationError`] when the file can not be read, or its rollout is none of this scenario.
    pub fn tracks(
        &self,
        scenario: &Scenario,
        simulator: usize,
        rollout: u32,
    ) -> Result<Option<Vec<Vec<Frame>>>, EvaluationError> {
        let Some(rollouts) = &self.rollouts else { return Ok(None) };
        let simulator = &self.tally.simulators[simulator];
        let Some(record) = rollouts.read(&scenario.id, simulator, rollout)? else { return Ok(None) };
        let foreign = |source| EvaluationError::ForeignRollout {
            path: self.folder.join(ROLLOUTS),
            scenario: scenario.id.clone(),
            source,
        };
        recorded_tracks(scenario, &record).map(Some).map_err(foreign)
    }
}
