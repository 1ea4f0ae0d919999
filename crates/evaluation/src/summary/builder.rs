//! Summaries of scenarios that are added one after the other.

use std::collections::BTreeMap;

use reactsim_metrics::Scope;

use crate::provenance::Provenance;
use crate::row::{Failure, RowLength};
use crate::statistics::samples::{NamedSamples, Part, Samples};
use crate::statistics::tally::{Entry, Tally};
use crate::statistics::{MANY, RESAMPLES_OF_MANY};
use crate::summary::{
    CategorySummary, LengthSummary, NoteSummary, PAIRING_REFERENCE, Pressure, SimulatorSummary, Summary,
    SummaryProvenance,
};

/// A summary that is being computed. Scenarios are added in canonical order.
pub(crate) struct SummaryBuilder<'a> {
    provenance: &'a Provenance,
    /// Metrics that are computed only if the AV is judged.
    of_av: Vec<&'static str>,
    simulators: Vec<SimulatorTotals>,
    pressure: [Option<usize>; 3],
    samples: Samples,
    deviation: NamedSamples,
    scenarios: usize,
    digest: blake3::Hasher,
    direction_tracking: BTreeMap<String, usize>,
    notes: BTreeMap<String, NoteSummary>,
    /// Number of scenarios by length.
    lengths: BTreeMap<RowLength, usize>,
}

/// Counts of one simulator.
#[derive(Clone, Default)]
struct SimulatorTotals {
    scenarios: usize,
    by_category: BTreeMap<String, usize>,
    by_difficulty: BTreeMap<String, usize>,
    /// Sum and number of the shares of rollouts with an event, for the metrics of the reactive pressure.
    pressure: [(f64, u32); 3],
    outcomes: BTreeMap<String, u64>,
}

impl<'a> SummaryBuilder<'a> {
    /// Begins a summary of the simulators and metrics of a tally.
    pub(crate) fn new(tally: &Tally, provenance: &'a Provenance) -> Self {
        let simulators = &tally.simulators;
        let seed = provenance.settings.seed;
        let reference = simulators.iter().position(|s| s == PAIRING_REFERENCE);
        Self {
            provenance,
            of_av: tally.metrics.iter().filter(|m| m.scope == Scope::Av).map(|m| m.id).collect(),
            simulators: vec![SimulatorTotals::default(); simulators.len()],
            pressure: ["aav-collision", "aav-overlap", "aav-ttc"].map(|id| tally.metric(id)),
            samples: Samples::new(
                seed,
                tally.metrics.iter().map(|m| m.id).collect(),
                simulators.len(),
                reference,
            ),
            deviation: NamedSamples::new(seed),
            scenarios: 0,
            digest: blake3::Hasher::new(),
            direction_tracking: BTreeMap::new(),
            notes: BTreeMap::new(),
            lengths: BTreeMap::new(),
        }
    }

    /// Adds the next scenario.
    pub(crate) fn add(&mut self, entry: &Entry) {
        self.samples.add(entry);
        self.deviation.add(&entry.deviation);
        self.scenarios += 1;
        self.digest.update(entry.scenario.as_bytes());
        self.digest.update(b"\0");
        self.digest.update(entry.digest.as_bytes());
        self.digest.update(b"\n");
        *self.lengths.entry(entry.length).or_default() += 1;
        if let Some(method) = &entry.direction_tracking {
            *self.direction_tracking.entry(method.clone()).or_default() += 1;
        }
        for (id, note) in &entry.notes {
            let summary = self.notes.entry(id.clone()).or_default();
            summary.scenarios += 1;
            summary.count += u64::from(note.count);
            if summary.first.is_none() {
                summary.first = note.detail.as_ref().map(|detail| format!("`{}`, {detail}", entry.scenario));
            }
        }
        for (totals, cell) in self.simulators.iter_mut().zip(&entry.cells) {
            let Some(cell) = cell else { continue };
            totals.scenarios += 1;
            if let Some(name) = &entry.category {
                *totals.by_category.entry(name.clone()).or_default() += 1;
            }
            if let Some(name) = &entry.difficulty {
                *totals.by_difficulty.entry(name.clone()).or_default() += 1;
            }
            for (sum, metric) in totals.pressure.iter_mut().zip(self.pressure) {
                if let Some(share) = metric.and_then(|m| cell.any[m]) {
                    *sum = (sum.0 + share, sum.1 + 1);
                }
            }
            for (name, n) in &cell.outcomes {
                *totals.outcomes.entry(name.clone()).or_default() += n;
            }
        }
    }

    /// Returns the summary. `failures` are in canonical order.
    pub(crate) fn finish(self, failures: &[Failure]) -> Summary {
        let intervals = (self.scenarios > MANY)
            .then(|| format!("{RESAMPLES_OF_MANY} resamples of more than {MANY} scenarios"));
        let has_reference = self.provenance.simulators.iter().any(|s| s.id == PAIRING_REFERENCE);
        let estimates = self.samples.finish();
        let judges_av = self.provenance.settings.planner().is_some();
        let is_kept = |id: &str| judges_av || !self.of_av.contains(&id);
        let estimates_of = |simulator: usize, part: &Part| {
            let mut all = estimates.of(simulator, part);
            all.retain(|id, _| is_kept(id));
            all
        };
        let all = self.provenance.simulators.iter().zip(self.simulators).enumerate();
        let simulators = all.map(|(i, (simulator, totals))| {
            let parts = |counts: BTreeMap<String, usize>, part: fn(String) -> Part| {
                let summary = |(name, scenarios): (String, usize)| {
                    let metrics = estimates_of(i, &part(name.clone()));
                    (name, CategorySummary { scenarios, metrics })
                };
                counts.into_iter().map(summary).collect()
            };
            let [at_fault, overlap, risky] =
                totals.pressure.map(|(sum, n)| (n > 0).then(|| sum / f64::from(n)));
            let summary = SimulatorSummary {
                scenarios: totals.scenarios,
                failed: failed(failures, &simulator.id),
                oracle: simulator.oracle,
                external: simulator.external.as_ref().map(|_| simulator.access()),
                metrics: estimates_of(i, &Part::All),
                by_category: parts(totals.by_category, Part::Category),
                by_difficulty: parts(totals.by_difficulty, Part::Difficulty),
                paired_to_log_replay: match has_reference && simulator.id != PAIRING_REFERENCE {
                    true => estimates_of(i, &Part::Paired),
                    false => BTreeMap::new(),
                },
                pressure: Pressure {
                    share_at_fault_collision: at_fault,
                    share_any_overlap: overlap,
                    share_risky: risky,
                },
                outcomes: totals.outcomes,
            };
            (simulator.id.clone(), summary)
        });
        let simulators: BTreeMap<String, SimulatorSummary> = simulators.collect();
        let mut allowed: BTreeMap<String, usize> = BTreeMap::new();
        for (check, n) in simulators.values().flat_map(SimulatorSummary::allowed) {
            *allowed.entry(check.allowance().to_owned()).or_default() +=
                usize::try_from(n).unwrap_or(usize::MAX);
        }
        let stated = |(length, scenarios): (&RowLength, &usize)| LengthSummary {
            history: length.history,
            steps: length.steps,
            scenarios: *scenarios,
        };
        let is_usual = self.lengths.keys().all(|length| *length == RowLength::BENCHMARK);
        let lengths = if is_usual { Vec::new() } else { self.lengths.iter().map(stated).collect() };
        Summary {
            simulators,
            deviation: self.deviation.finish(),
            provenance: SummaryProvenance {
                run: Provenance { keep_rollouts: None, ..self.provenance.clone() },
                scenarios: self.scenarios,
                scenarios_blake3: self.digest.finalize().to_hex().to_string(),
                allowed,
                intervals,
                notes: self.notes,
                lengths,
                direction_tracking: self.direction_tracking,
                failures: failures.to_vec(),
                ..SummaryProvenance::default()
            },
        }
    }
}

impl Summary {
    /// Summarizes a run. `failures` are in canonical order.
    pub fn new(tally: &Tally, failures: &[Failure], provenance: &Provenance) -> Self {
        let mut builder = SummaryBuilder::new(tally, provenance);
        tally.entries.values().for_each(|entry| builder.add(entry));
        builder.finish(failures)
    }
}

/// Returns the number of records that failed for a simulator.
fn failed(failures: &[Failure], simulator: &str) -> usize {
    failures.iter().filter(|f| f.simulator.as_deref().is_none_or(|s| s == simulator)).count()
}
