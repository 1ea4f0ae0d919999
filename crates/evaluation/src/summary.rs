//! The result of a run: `summary.json`.

mod compute;

use std::collections::{BTreeMap, BTreeSet};

use reactsim_scene::note_text;
use serde::{Deserialize, Serialize};

use crate::motion::kind::RolloutCheck;
use crate::provenance::Provenance;
use crate::row::{Failure, RowLength, by_metric};
use crate::simulators::access::{Access, TableMarks};
use crate::statistics::Estimate;
use crate::statistics::tally::Tally;

/// Id of the simulator to which paired differences are computed.
pub const PAIRING_REFERENCE: &str = "log-replay";

/// The result of a run. Its bytes depend on inputs, settings and program only, not on time, threads or
/// batches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Summary {
    /// Result per simulator, by id.
    pub simulators: BTreeMap<String, SimulatorSummary>,
    /// Statistics of the deviated AV against the logged AV over the scenarios, by name; empty without a
    /// deviated AV.
    pub deviation: BTreeMap<String, Estimate>,
    /// Provenance of the numbers.
    pub provenance: SummaryProvenance,
}

/// The result of one simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorSummary {
    /// Number of scenarios with a result.
    pub scenarios: usize,
    /// Number of scenarios without a result.
    pub failed: usize,
    /// Whether the simulator gets the log's future (†).
    pub oracle: bool,
    /// Knowledge of an external simulator beyond its observations; `None` for others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub external: Option<Access>,
    /// Estimate per metric, by id.
    #[serde(deserialize_with = "by_metric")]
    pub metrics: BTreeMap<String, Estimate>,
    /// Results per category of deviation.
    pub by_category: BTreeMap<String, CategorySummary>,
    /// Results per difficulty of the deviation; empty if no difficulty is known.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub by_difficulty: BTreeMap<String, CategorySummary>,
    /// Difference to log replay over the scenarios in which both have a value; empty if log replay did not
    /// run.
    #[serde(deserialize_with = "by_metric")]
    pub paired_to_log_replay: BTreeMap<String, Estimate>,
    /// Reactive pressure: shares of the scenarios.
    pub pressure: Pressure,
    /// Number of outcomes of parts of plans, by name.
    pub outcomes: BTreeMap<String, u64>,
}

/// The result of one simulator in the scenarios of one category or difficulty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CategorySummary {
    /// Number of scenarios with a result.
    pub scenarios: usize,
    /// Estimate per metric, by id.
    #[serde(deserialize_with = "by_metric")]
    pub metrics: BTreeMap<String, Estimate>,
}

/// Shares of scenarios (averaged over rollouts) in which an event occurs at least once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pressure {
    /// An agent hits the AV and is at fault.
    pub share_at_fault_collision: Option<f64>,
    /// A vehicle overlaps the AV, regardless of fault.
    pub share_any_overlap: Option<f64>,
    /// A vehicle has a time to collision with the AV below 0.5 s.
    pub share_risky: Option<f64>,
}

/// Provenance with facts about the finished run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SummaryProvenance {
    /// Program, settings, inputs, models.
    #[serde(flatten)]
    pub run: Provenance,
    /// Number of scenarios with at least one result.
    pub scenarios: usize,
    /// BLAKE3 digest of their ids and digests, in order.
    pub scenarios_blake3: String,
    /// Number of scenarios that were skipped because the file of deviations does not name them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub passed_over: usize,
    /// Number of scenarios that were not selected.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub unselected: usize,
    /// Selected ids that no scenario has.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missing_ids: Vec<String>,
    /// Number of deviations whose scenario was not read: unknown, or beyond the limit.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub unused_deviations: usize,
    /// Number of rollouts that fail a check which the user allowed, by allowance.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub allowed: BTreeMap<String, usize>,
    /// How intervals are computed if not by the usual number of resamples: very many scenarios have fewer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intervals: Option<String>,
    /// Properties of scenarios that affect how the results are read, by id.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub notes: BTreeMap<String, NoteSummary>,
    /// Lengths of the scenarios, in ascending order; empty if all have that of the benchmark.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths: Vec<LengthSummary>,
    /// Number of scenarios by the method of assigning lanes for the driving direction.
    pub direction_tracking: BTreeMap<String, usize>,
    /// Failures.
    pub failures: Vec<Failure>,
}

/// The scenarios of one length.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LengthSummary {
    /// Frames up to and including the current one.
    pub history: usize,
    /// Steps after the current frame.
    pub steps: usize,
    /// Number of scenarios.
    pub scenarios: usize,
}

impl SummaryProvenance {
    /// Returns the duration of the scenarios, such as `15 s (150 steps)` or `8 to 15 s (80 to 150 steps)`,
    /// and their history if it is not that of the benchmark; `None` if all have the length of the benchmark.
    pub fn duration(&self) -> Option<String> {
        let lengths = self.lengths.iter();
        RowLength::duration(lengths.map(|&LengthSummary { history, steps, .. }| RowLength { history, steps }))
    }

    /// As [`Self::duration`], also for the length of the benchmark.
    pub fn stated_duration(&self) -> String {
        let benchmark = || RowLength::duration([RowLength::BENCHMARK]);
        self.duration().or_else(benchmark).unwrap_or_default()
    }
}

/// A property of scenarios.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoteSummary {
    /// Number of scenarios with the property.
    pub scenarios: usize,
    /// Number of occurrences in all of them.
    pub count: u64,
    /// Scenario and place of the first occurrence, if it has a place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<String>,
}

impl NoteSummary {
    /// Returns the text of the note with this id, with its counts.
    pub fn text(&self, id: &str) -> String {
        let scenarios = format!("{} scenario{}", self.scenarios, if self.scenarios == 1 { "" } else { "s" });
        let first = self.first.as_ref().map(|first| format!(" (first: {first})")).unwrap_or_default();
        format!("{scenarios}: {}{first}", note_text(id, self.count))
    }
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

impl SimulatorSummary {
    /// Returns what the simulator can know beyond its observations.
    pub fn access(&self) -> Access {
        if self.oracle { Access::Oracle } else { self.external.unwrap_or(Access::Blind) }
    }

    /// Returns what tables mark about the simulator.
    pub fn marks(&self) -> TableMarks {
        TableMarks { access: self.access(), is_allowed: self.allowed().next().is_some() }
    }

    /// Returns the checks that some of its rollouts fail and the user allowed, with their numbers of
    /// rollouts.
    pub fn allowed(&self) -> impl Iterator<Item = (RolloutCheck, u64)> {
        let count = |check: RolloutCheck| Some((check, *self.outcomes.get(check.outcome())?));
        RolloutCheck::ALL.into_iter().filter_map(count)
    }
}

impl Summary {
    /// Returns whether this summary can be of the tally: both have the same number of results per simulator.
    pub(crate) fn is_of(&self, tally: &Tally) -> bool {
        let with_result = |i: usize| tally.entries.values().filter(|e| e.cells[i].is_some()).count();
        let mut counts = tally.simulators.iter().enumerate().map(|(i, id)| (id, with_result(i)));
        counts.all(|(id, n)| self.simulators.get(id).is_some_and(|s| s.scenarios == n))
    }

    /// Returns the ids of all metrics that some simulator has, with or without a value.
    pub(super) fn metrics(&self) -> BTreeSet<String> {
        self.simulators.values().flat_map(|simulator| simulator.metrics.keys().cloned()).collect()
    }

    /// Removes all metrics but these. Results of an earlier program lack metrics that were added since.
    pub(super) fn restrict_to(&mut self, metrics: &BTreeSet<String>) {
        for simulator in self.simulators.values_mut() {
            let parts = simulator.by_category.values_mut().chain(simulator.by_difficulty.values_mut());
            let parts = parts.map(|part| &mut part.metrics);
            for estimates in parts.chain([&mut simulator.metrics, &mut simulator.paired_to_log_replay]) {
                estimates.retain(|metric, _| metrics.contains(metric));
            }
        }
    }

    /// Returns the text of `summary.json`.
    pub fn to_json(&self) -> String {
        let mut text =
            serde_json::to_string_pretty(self).expect("a summary holds finite numbers and text only");
        text.push('\n');
        text
    }

    /// Returns id, title and summary of each simulator, in the order of the tables.
    pub fn order(&self) -> impl Iterator<Item = (&str, &str, &SimulatorSummary)> {
        let records = self.provenance.run.simulators.iter();
        records.filter_map(|s| Some((s.id.as_str(), s.title.as_str(), self.simulators.get(&s.id)?)))
    }
}
