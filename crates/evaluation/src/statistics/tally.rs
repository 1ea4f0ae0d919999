//! The values of a run, small enough to keep in memory for all scenarios.

use std::collections::BTreeMap;

use reactsim_metrics::{MetricSpec, Score};

use crate::error::EvaluationError;
use crate::row::{RecordPosition, Row, RowLength, RowNote};
use crate::statistics::mean;

/// The values of one simulator in one scenario, averaged over its rollouts.
#[derive(Clone, Debug, Default)]
pub struct Cell {
    /// Value per metric, in the order of the tally's metrics; `None` if no rollout has one.
    pub values: Vec<Option<f64>>,
    /// Outcomes of parts of plans, summed over the rollouts.
    pub outcomes: BTreeMap<String, u64>,
    /// Share of the rollouts with a count of at least 1, for every count metric; in the order of the tally's
    /// metrics.
    pub any: Vec<Option<f64>>,
}

/// A scenario with a cell per simulator.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Id of the scenario.
    pub scenario: String,
    /// Digest of the scenario.
    pub digest: String,
    /// Category of the deviation, if known.
    pub category: Option<String>,
    /// Difficulty of avoiding the deviated AV, if known.
    pub difficulty: Option<String>,
    /// Method of assigning lanes for the driving direction.
    pub direction_tracking: Option<String>,
    /// Statistics of the AV against the logged AV. In the realism protocol, in which every simulator moves
    /// the AV in its own way, those of the first simulator.
    pub deviation: BTreeMap<String, f64>,
    /// Properties of the scenario that affect how the results are read, by id.
    pub notes: BTreeMap<String, RowNote>,
    /// Length of the scenario.
    pub length: RowLength,
    /// Index of the simulator of these statistics.
    deviation_of: usize,
    /// One cell per simulator; `None` without a result.
    pub cells: Vec<Option<Cell>>,
}

/// All values of a run, in canonical order.
#[derive(Clone, Debug)]
pub struct Tally {
    /// The metrics.
    pub metrics: Vec<&'static MetricSpec>,
    /// Ids of the simulators, in the order of the tables.
    pub simulators: Vec<String>,
    /// Number of rollouts per scenario and simulator.
    pub rollouts: u32,
    /// Scenarios by position in the inputs.
    pub entries: BTreeMap<RecordPosition, Entry>,
}

impl Tally {
    /// Returns the index of the metric with this id.
    pub fn metric(&self, id: &str) -> Option<usize> {
        self.metrics.iter().position(|spec| spec.id == id)
    }

    /// Returns the index of the simulator with this id.
    ///
    /// # Errors
    /// [`EvaluationError`] if the run has none.
    pub(crate) fn simulator(&self, id: &str) -> Result<usize, EvaluationError> {
        self.simulators.iter().position(|known| known == id).ok_or_else(|| {
            let known = self.simulators.join(", ");
            EvaluationError::Refused(format!("the run has no simulator `{id}`; it has: {known}"))
        })
    }

    /// Returns whether `rows` are all rows of one scenario and one simulator: one per rollout, and one over
    /// all rollouts.
    pub fn is_complete(&self, rows: &[Row]) -> bool {
        let mut found: Vec<Option<u32>> = rows.iter().map(|r| r.rollout).collect();
        found.sort();
        let expected = std::iter::once(None).chain((0..self.rollouts).map(Some));
        found.into_iter().eq(expected)
    }

    /// Adds the rows of one scenario and one simulator. Rows of unknown simulators are ignored.
    pub fn add(&mut self, rows: &[Row]) {
        let Some(first) = rows.first() else { return };
        let Some(simulator) = self.simulators.iter().position(|s| *s == first.simulator) else { return };
        let count = self.simulators.len();
        let entry = self.entries.entry(first.place()).or_insert_with(|| Entry {
            scenario: first.scenario.clone(),
            digest: first.digest.clone(),
            category: first.category.clone(),
            difficulty: first.difficulty.clone(),
            direction_tracking: None,
            deviation: BTreeMap::new(),
            notes: first.notes.clone(),
            length: first.length.unwrap_or(RowLength::BENCHMARK),
            deviation_of: usize::MAX,
            cells: vec![None; count],
        });
        let mut cell = Cell::default();
        for metric in &self.metrics {
            let scores: Vec<Score> =
                rows.iter().filter_map(|r| r.metrics.get(metric.id).copied().flatten()).collect();
            cell.values.push(mean(scores.iter().filter_map(|s| s.value())));
            cell.any.push(mean(scores.iter().filter_map(|s| match s {
                Score::Count(n) => Some(if *n > 0 { 1.0 } else { 0.0 }),
                _ => None,
            })));
        }
        for row in rows {
            for (name, n) in &row.outcomes {
                *cell.outcomes.entry(name.clone()).or_default() += n;
            }
            if entry.direction_tracking.is_none() {
                entry.direction_tracking.clone_from(&row.direction_tracking);
            }
            // Rows arrive in any order.
            if simulator < entry.deviation_of && !row.deviation.is_empty() {
                entry.deviation.clone_from(&row.deviation);
                entry.deviation_of = simulator;
            }
        }
        entry.cells[simulator] = Some(cell);
    }

    /// Returns whether the pair of scenario and simulator has a result.
    pub fn has(&self, place: RecordPosition, simulator: usize) -> bool {
        self.entries.get(&place).is_some_and(|e| e.cells[simulator].is_some())
    }

    /// Returns the positions of scenarios with the id of an earlier scenario, each with the position of the
    /// earlier one.
    pub fn repeated(&self) -> Vec<(RecordPosition, RecordPosition)> {
        let mut first: BTreeMap<&str, RecordPosition> = BTreeMap::new();
        let mut repeated = Vec::new();
        for (place, entry) in &self.entries {
            match first.get(entry.scenario.as_str()) {
                Some(earlier) => repeated.push((*place, *earlier)),
                None => {
                    first.insert(&entry.scenario, *place);
                }
            }
        }
        repeated
    }
}
