//! Computes the summary of a run.

use std::collections::BTreeMap;

use reactsim_metrics::Scope;

use crate::provenance::Provenance;
use crate::row::{Failure, RowLength};
use crate::statistics::samples::Samples;
use crate::statistics::tally::{Cell, Tally};
use crate::statistics::{MANY, RESAMPLES_OF_MANY, mean};
use crate::summary::{
    LengthSummary, NoteSummary, PAIRING_REFERENCE, Pressure, SimulatorSummary, Summary, SummaryProvenance,
};

impl Summary {
    /// Summarizes a run. `failures` are in canonical order.
    pub fn new(tally: &Tally, failures: &[Failure], provenance: &Provenance) -> Self {
        let simulators = simulators(tally, failures, provenance);
        let mut allowed: BTreeMap<String, usize> = BTreeMap::new();
        for (check, n) in simulators.values().flat_map(SimulatorSummary::allowed) {
            *allowed.entry(check.allowance().to_owned()).or_default() +=
                usize::try_from(n).unwrap_or(usize::MAX);
        }
        let mut digest = blake3::Hasher::new();
        let mut notes: BTreeMap<String, NoteSummary> = BTreeMap::new();
        for entry in tally.entries.values() {
            for part in [entry.scenario.as_str(), "\0", &entry.digest, "\n"] {
                digest.update(part.as_bytes());
            }
            for (id, note) in &entry.notes {
                let summary = notes.entry(id.clone()).or_default();
                summary.scenarios += 1;
                summary.count += u64::from(note.count);
                if summary.first.is_none() {
                    summary.first =
                        note.detail.as_ref().map(|detail| format!("`{}`, {detail}", entry.scenario));
                }
            }
        }
        let scenarios = tally.entries.len();
        Self {
            simulators,
            deviation: Samples::new(tally, provenance.settings.seed).deviation(),
            provenance: SummaryProvenance {
                run: Provenance { keep_rollouts: None, ..provenance.clone() },
                scenarios,
                scenarios_blake3: digest.finalize().to_hex().to_string(),
                allowed,
                intervals: (scenarios > MANY)
                    .then(|| format!("{RESAMPLES_OF_MANY} resamples of more than {MANY} scenarios")),
                notes,
                lengths: lengths(tally),
                direction_tracking: counts(
                    tally.entries.values().filter_map(|e| e.direction_tracking.clone()),
                ),
                failures: failures.to_vec(),
                ..SummaryProvenance::default()
            },
        }
    }
}

/// Returns the result of each simulator.
fn simulators(
    tally: &Tally,
    failures: &[Failure],
    provenance: &Provenance,
) -> BTreeMap<String, SimulatorSummary> {
    let mut samples = Samples::new(tally, provenance.settings.seed);
    if provenance.settings.planner().is_none() {
        // These are computed only if the AV is judged.
        samples.metrics.retain(|&(metric, _)| tally.metrics[metric].scope != Scope::Av);
    }
    let reference = tally.simulators.iter().position(|id| id == PAIRING_REFERENCE);
    let pressure = ["aav-collision", "aav-overlap", "aav-ttc"].map(|id| tally.metric(id));
    let all = provenance.simulators.iter().enumerate().map(|(i, simulator)| {
        let cells = || tally.entries.values().filter_map(|entry| entry.cells[i].as_ref());
        let share = |metric: Option<usize>| {
            metric.and_then(|metric| mean(cells().filter_map(|cell| cell.any[metric])))
        };
        let [share_at_fault_collision, share_any_overlap, share_risky] = pressure.map(share);
        let mut outcomes: BTreeMap<String, u64> = BTreeMap::new();
        for (name, n) in cells().flat_map(|cell: &Cell| &cell.outcomes) {
            *outcomes.entry(name.clone()).or_default() += n;
        }
        let summary = SimulatorSummary {
            scenarios: cells().count(),
            failed: failed(failures, &simulator.id),
            oracle: simulator.oracle,
            external: simulator.external.as_ref().map(|_| simulator.access()),
            metrics: samples.of(i),
            by_category: samples.by_part(i, |entry| entry.category.as_deref()),
            by_difficulty: samples.by_part(i, |entry| entry.difficulty.as_deref()),
            paired_to_log_replay: match reference.filter(|&reference| reference != i) {
                Some(reference) => samples.paired(i, reference),
                None => BTreeMap::new(),
            },
            pressure: Pressure { share_at_fault_collision, share_any_overlap, share_risky },
            outcomes,
        };
        (simulator.id.clone(), summary)
    });
    all.collect()
}

/// Returns the lengths of the scenarios; none if all have that of the benchmark.
fn lengths(tally: &Tally) -> Vec<LengthSummary> {
    let counts = counts(tally.entries.values().map(|entry| entry.length));
    if counts.keys().all(|length| *length == RowLength::BENCHMARK) {
        return Vec::new();
    }
    let summary = |(RowLength { history, steps }, scenarios)| LengthSummary { history, steps, scenarios };
    counts.into_iter().map(summary).collect()
}

/// Returns how often each value occurs.
fn counts<T: Ord>(values: impl Iterator<Item = T>) -> BTreeMap<T, usize> {
    let mut counts = BTreeMap::new();
    values.for_each(|value| *counts.entry(value).or_default() += 1);
    counts
}

/// Returns the number of records that failed for a simulator.
fn failed(failures: &[Failure], simulator: &str) -> usize {
    failures.iter().filter(|f| f.simulator.as_deref().is_none_or(|s| s == simulator)).count()
}
