//! Rows of a run folder: the scores of one rollout, as one line.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_metrics::{Event, REMOVED_METRICS, Score};
use reactsim_scene::{FUTURE, HISTORY, Length, Note, Scenario};
use serde::{Deserialize, Deserializer, Serialize};

use crate::deviation::labels::DeviationLabels;
use crate::source::file_record::FileRecord;

/// The position of a record: its input and its index there. Everything that a run writes is sorted by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
pub struct RecordPosition {
    /// Index of the input file.
    pub input: usize,
    /// Index of the record in it.
    pub record: usize,
}

/// The scores of one scenario, simulator and rollout; or, without a rollout, of all rollouts of the pair
/// together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Index of the input file.
    pub input: usize,
    /// Index of the record in it.
    pub record: usize,
    /// Id of the scenario.
    pub scenario: String,
    /// BLAKE3 digest of the scenario.
    pub digest: String,
    /// Id of the simulator.
    pub simulator: String,
    /// Index of the rollout; `None` for the metrics over all rollouts of the pair.
    pub rollout: Option<u32>,
    /// Category of the deviation, if known.
    pub category: Option<String>,
    /// Difficulty of avoiding the deviated AV, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub difficulty: Option<String>,
    /// Method of assigning lanes for the driving direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction_tracking: Option<String>,
    /// Value per metric; `None` if nothing could be evaluated.
    #[serde(deserialize_with = "by_metric")]
    pub metrics: BTreeMap<String, Option<Score>>,
    /// Statistics of the deviated AV against the logged AV, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub deviation: BTreeMap<String, f64>,
    /// Number of outcomes of parts of plans, by name. If the AV is judged, also the inputs of its metrics that
    /// were substituted, and its undefined metrics with their reasons (`av …`).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub outcomes: BTreeMap<String, u64>,
    /// Properties of the scenario that affect how the results are read, by id.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub notes: BTreeMap<String, RowNote>,
    /// Length of the scenario; `None` for that of the benchmark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length: Option<RowLength>,
}

/// The length of a scenario as stored in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowLength {
    /// Frames up to and including the current one.
    pub history: usize,
    /// Steps after the current frame.
    pub steps: usize,
}

impl RowLength {
    /// The length of the benchmark, which files do not state.
    pub const BENCHMARK: Self = Self { history: HISTORY, steps: FUTURE };

    /// Returns the length for files: `None` for that of the benchmark.
    pub(super) fn stated(Length { history, future }: Length) -> Option<Self> {
        Some(Self { history, steps: future }).filter(|length| *length != Self::BENCHMARK)
    }

    /// Returns the duration of scenarios of these lengths, such as `8 to 15 s (80 to 150 steps)`, and their
    /// history if it is not that of the benchmark; `None` without any.
    pub(crate) fn duration(lengths: impl IntoIterator<Item = Self>) -> Option<String> {
        let lengths: Vec<Self> = lengths.into_iter().collect();
        let range = |of: fn(&Self) -> usize| {
            let all = || lengths.iter().map(of);
            all().min().zip(all().max())
        };
        let ((least, most), (first, last)) =
            range(|length| length.steps).zip(range(|length| length.history))?;
        let seconds = |steps: usize| match steps % 10 {
            0 => (steps / 10).to_string(),
            tenth => format!("{}.{tenth}", steps / 10),
        };
        let mut text = if least == most {
            format!("{} s ({most} step{})", seconds(most), if most == 1 { "" } else { "s" })
        } else {
            format!("{} to {} s ({least} to {most} steps)", seconds(least), seconds(most))
        };
        if first != last {
            text += &format!(" after {first} to {last} frames of history");
        } else if first != Self::BENCHMARK.history {
            text += &format!(" after {first} frames of history");
        }
        Some(text)
    }
}

/// A property of a scenario ([`Scenario::notes`]) as stored in files.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowNote {
    /// Number of occurrences.
    pub count: u32,
    /// The first occurrence, if it has a place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

/// Reads values by metric. Those of metrics that only earlier versions have are left out.
pub(super) fn by_metric<'de, D, V>(file: D) -> Result<BTreeMap<String, V>, D::Error>
where
    D: Deserializer<'de>,
    V: Deserialize<'de>,
{
    let mut values = BTreeMap::<String, V>::deserialize(file)?;
    values.retain(|id, _| !REMOVED_METRICS.contains(&id.as_str()));
    Ok(values)
}

impl Row {
    /// Creates the row of a scenario and a simulator over all rollouts, without values.
    pub(super) fn about(place: RecordPosition, scenario: &Scenario, digest: String, simulator: &str) -> Self {
        let note = |note: &Note| RowNote { count: note.count, detail: note.detail.clone() };
        let notes = scenario.notes().iter().map(|(id, found)| (id, note(found)));
        Self {
            input: place.input,
            record: place.record,
            scenario: scenario.id.clone(),
            digest,
            simulator: simulator.to_owned(),
            notes: notes.map(|(id, note)| (id.to_string(), note)).collect(),
            length: RowLength::stated(scenario.length()),
            ..Self::default()
        }
    }

    /// Returns the number of steps of the scenario.
    pub(super) fn steps(&self) -> usize {
        self.length.unwrap_or(RowLength::BENCHMARK).steps
    }

    /// Sets category and difficulty of the deviation.
    pub(super) fn with_deviation(self, deviation: &DeviationLabels) -> Self {
        Self {
            category: deviation.category.map(|c| c.name().to_owned()),
            difficulty: deviation.difficulty().map(|d| d.name().to_owned()),
            ..self
        }
    }

    /// Returns the ids of all metrics that some row has, with or without a value.
    pub(super) fn metrics_of<'r>(rows: impl IntoIterator<Item = &'r Self>) -> BTreeSet<String> {
        rows.into_iter().flat_map(|row| row.metrics.keys().cloned()).collect()
    }

    /// Removes all metrics but these. Results of an earlier program lack metrics that were added since.
    pub(super) fn restrict_to(&mut self, metrics: &BTreeSet<String>) {
        self.metrics.retain(|metric, _| metrics.contains(metric));
    }

    /// Returns the position of the scenario.
    pub fn place(&self) -> RecordPosition {
        RecordPosition { input: self.input, record: self.record }
    }
}

/// The part of a line of `events.jsonl` that counting needs; it is read three times as fast as the line.
#[derive(Debug, Deserialize)]
pub(super) struct EventHead {
    input: usize,
    record: usize,
    pub(super) simulator: String,
    pub(super) rollout: u32,
    pub(super) metric: String,
    pub(super) counted: bool,
}

impl EventHead {
    /// Returns the position of the scenario.
    pub(super) fn place(&self) -> RecordPosition {
        RecordPosition { input: self.input, record: self.record }
    }
}

/// An event as one line of `events.jsonl`, with its record, scenario and simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EventLine {
    /// Index of the input file.
    pub input: usize,
    /// Index of the record in it.
    pub record: usize,
    /// Id of the scenario.
    pub scenario: String,
    /// Id of the simulator.
    pub simulator: String,
    /// The event.
    #[serde(flatten)]
    pub event: EventRecord,
}

/// An event as stored in files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EventRecord {
    /// Index of the rollout.
    pub rollout: u32,
    /// Id of the metric.
    pub metric: String,
    /// First step, from 1.
    pub step: usize,
    /// Last step.
    pub last_step: usize,
    /// Id of the agent.
    pub agent: String,
    /// Id of the partner.
    pub partner: Option<String>,
    /// Reason why the event counts or not.
    pub reason: Option<String>,
    /// Whether the event counts in the metric's value.
    pub counted: bool,
    /// Named values at the event; those that are not finite are left out.
    pub values: BTreeMap<String, f64>,
}

impl EventLine {
    /// Creates the line of an event in the scenario and with the simulator of a row.
    pub(super) fn of(row: &Row, event: EventRecord) -> Self {
        let (scenario, simulator) = (row.scenario.clone(), row.simulator.clone());
        Self { input: row.input, record: row.record, scenario, simulator, event }
    }

    /// Creates the line of an event of a rollout.
    pub fn new(row: &Row, rollout: u32, event: &Event) -> Self {
        let finite = event.values.iter().filter(|(_, value)| value.is_finite());
        let record = EventRecord {
            rollout,
            metric: event.metric.to_owned(),
            step: event.step,
            last_step: event.last_step,
            agent: event.agent.clone(),
            partner: event.partner.clone(),
            reason: event.reason.map(str::to_owned),
            counted: event.counted,
            values: finite.map(|(name, value)| ((*name).to_owned(), *value)).collect(),
        };
        Self::of(row, record)
    }
}

/// A scenario, a file or a pair of scenario and simulator without a result.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Failure {
    /// Index of the input file.
    pub input: usize,
    /// Index of the record in it.
    pub record: usize,
    /// Id of the simulator; `None` if the scenario failed for all simulators.
    pub simulator: Option<String>,
    /// Name of the input file.
    pub file: String,
    /// Id of the scenario, if it could be read.
    pub scenario: Option<String>,
    /// Text of the error.
    pub error: String,
}

impl Failure {
    /// Creates the failure of a record of a file, with all simulators.
    pub(super) fn new(
        place: RecordPosition,
        file: &FileRecord,
        scenario: Option<String>,
        error: impl ToString,
    ) -> Self {
        let RecordPosition { input, record } = place;
        let (file, error) = (file.name.clone(), error.to_string());
        Self { input, record, simulator: None, file, scenario, error }
    }

    /// Returns the position of the record.
    pub fn place(&self) -> RecordPosition {
        RecordPosition { input: self.input, record: self.record }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_stated_with_a_history_that_is_not_the_benchmarks() {
        let of = |lengths: &[(usize, usize)]| {
            RowLength::duration(lengths.iter().map(|&(history, steps)| RowLength { history, steps }))
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[(11, 150)]).unwrap(), "15 s (150 steps)");
        assert_eq!(of(&[(11, 1)]).unwrap(), "0.1 s (1 step)");
        assert_eq!(of(&[(11, 80), (11, 155)]).unwrap(), "8 to 15.5 s (80 to 155 steps)");
        assert_eq!(of(&[(21, 80)]).unwrap(), "8 s (80 steps) after 21 frames of history");
        let mixed = "6 to 8 s (60 to 80 steps) after 2 to 11 frames of history";
        assert_eq!(of(&[(2, 60), (11, 80)]).unwrap(), mixed);
    }
}
