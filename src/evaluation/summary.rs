//! The result of a run: `summary.json`.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::access::Access;
use super::provenance::Provenance;
use super::row::Failure;
use super::statistics::{Estimate, mean};
use super::tally::{Cell, Entry, Tally};

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
    pub metrics: BTreeMap<String, Estimate>,
    /// Results per category of deviation.
    pub by_category: BTreeMap<String, CategorySummary>,
    /// Results per difficulty of the deviation; empty if no difficulty is known.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub by_difficulty: BTreeMap<String, CategorySummary>,
    /// Difference to log replay over the scenarios in which both have a value; empty if log replay did not
    /// run.
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Number of recorded rollouts that fail a check which the user allowed, by allowance.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub allowed: BTreeMap<String, usize>,
    /// Number of scenarios by the method of assigning lanes for the driving direction.
    pub direction_tracking: BTreeMap<String, usize>,
    /// Failures.
    pub failures: Vec<Failure>,
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

impl SimulatorSummary {
    /// Returns what the simulator can know beyond its observations.
    pub fn access(&self) -> Access {
        if self.oracle { Access::Oracle } else { self.external.unwrap_or(Access::Blind) }
    }
}

impl Summary {
    /// Summarizes a run. `failures` are in canonical order.
    pub fn new(tally: &Tally, failures: &[Failure], provenance: &Provenance) -> Self {
        let seed = provenance.settings.seed;
        let reference = tally.simulators.iter().position(|s| s == PAIRING_REFERENCE);
        let simulators = provenance.simulators.iter().enumerate().map(|(i, simulator)| {
            let done: Vec<(&Entry, &Cell)> =
                tally.entries.values().filter_map(|e| Some((e, e.cells[i].as_ref()?))).collect();
            let mut outcomes = BTreeMap::new();
            for (name, n) in done.iter().flat_map(|(_, c)| &c.outcomes) {
                *outcomes.entry(name.clone()).or_default() += n;
            }
            let summary = SimulatorSummary {
                scenarios: done.len(),
                failed: failed(failures, &simulator.id),
                oracle: simulator.oracle,
                external: simulator.external.as_ref().map(|_| simulator.access()),
                metrics: estimates(&tally.metrics, &done, seed, |_, cell, m| cell.values[m]),
                by_category: parts(tally, &done, seed, |entry| entry.category.as_ref()),
                by_difficulty: parts(tally, &done, seed, |entry| entry.difficulty.as_ref()),
                paired_to_log_replay: match reference {
                    Some(r) if r != i => estimates(&tally.metrics, &done, seed, |entry, cell, m| {
                        Some(cell.values[m]? - entry.cells[r].as_ref()?.values[m]?)
                    }),
                    _ => BTreeMap::new(),
                },
                pressure: Pressure::of(tally, &done),
                outcomes,
            };
            (simulator.id.clone(), summary)
        });
        let simulators = simulators.collect();
        let mut tracking = BTreeMap::new();
        for method in tally.entries.values().filter_map(|e| e.direction_tracking.clone()) {
            *tracking.entry(method).or_default() += 1;
        }
        let mut digest = blake3::Hasher::new();
        for entry in tally.entries.values() {
            digest.update(entry.scenario.as_bytes());
            digest.update(b"\0");
            digest.update(entry.digest.as_bytes());
            digest.update(b"\n");
        }
        Self {
            simulators,
            deviation: deviation(tally, seed),
            provenance: SummaryProvenance {
                run: Provenance { keep_rollouts: None, ..provenance.clone() },
                scenarios: tally.entries.len(),
                scenarios_blake3: digest.finalize().to_hex().to_string(),
                passed_over: 0,
                unselected: 0,
                missing_ids: Vec::new(),
                unused_deviations: 0,
                allowed: BTreeMap::new(),
                direction_tracking: tracking,
                failures: failures.to_vec(),
            },
        }
    }

    /// Returns whether this summary can be of the tally: both have the same number of results per simulator.
    pub fn is_of(&self, tally: &Tally) -> bool {
        let with_result = |i: usize| tally.entries.values().filter(|e| e.cells[i].is_some()).count();
        let mut counts = tally.simulators.iter().enumerate().map(|(i, id)| (id, with_result(i)));
        counts.all(|(id, n)| self.simulators.get(id).is_some_and(|s| s.scenarios == n))
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

/// Returns the number of records that failed for a simulator.
fn failed(failures: &[Failure], simulator: &str) -> usize {
    failures.iter().filter(|f| f.simulator.as_deref().is_none_or(|s| s == simulator)).count()
}

/// Returns the result of one simulator per part of the scenarios; `part` names the part that a scenario
/// belongs to, if any.
fn parts(
    tally: &Tally,
    done: &[(&Entry, &Cell)],
    seed: u64,
    part: impl Fn(&Entry) -> Option<&String>,
) -> BTreeMap<String, CategorySummary> {
    let mut cells: BTreeMap<&String, Vec<(&Entry, &Cell)>> = BTreeMap::new();
    for (entry, cell) in done {
        if let Some(name) = part(entry) {
            cells.entry(name).or_default().push((entry, cell));
        }
    }
    let summary = |cells: Vec<(&Entry, &Cell)>| CategorySummary {
        scenarios: cells.len(),
        metrics: estimates(&tally.metrics, &cells, seed, |_, cell, m| cell.values[m]),
    };
    cells.into_iter().map(|(name, cells)| (name.clone(), summary(cells))).collect()
}

/// Computes one estimate per metric over the scenarios with a value.
fn estimates(
    metrics: &[&'static str],
    cells: &[(&Entry, &Cell)],
    seed: u64,
    value: impl Fn(&Entry, &Cell, usize) -> Option<f64> + Sync,
) -> BTreeMap<String, Estimate> {
    let each: Vec<(String, Estimate)> = metrics
        .par_iter()
        .enumerate()
        .map(|(m, id)| {
            let values: Vec<f64> = cells.iter().filter_map(|(e, c)| value(e, c, m)).collect();
            ((*id).to_owned(), Estimate::of(&values, seed, id))
        })
        .collect();
    each.into_iter().collect()
}

fn deviation(tally: &Tally, seed: u64) -> BTreeMap<String, Estimate> {
    let mut values: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (name, value) in tally.entries.values().flat_map(|e| &e.deviation) {
        values.entry(name).or_default().push(*value);
    }
    values.into_iter().map(|(name, v)| (name.to_owned(), Estimate::of(&v, seed, name))).collect()
}

impl Pressure {
    fn of(tally: &Tally, done: &[(&Entry, &Cell)]) -> Self {
        let share = |id: &str| {
            let metric = tally.metrics.iter().position(|m| *m == id)?;
            mean(done.iter().filter_map(|(_, c)| c.any[metric]))
        };
        Self {
            share_at_fault_collision: share("aav-collision"),
            share_any_overlap: share("aav-overlap"),
            share_risky: share("aav-ttc"),
        }
    }
}
