//! Scores of rollouts recorded by any program.

use std::collections::BTreeMap;

use super::judge::judge;
use super::known_deviation::KnownDeviation;
use super::provenance::{Provenance, SimulatorRecord};
use super::rollout_checks::{self, Findings, RolloutCheck};
use super::rollouts::recorded_tracks;
use super::row::{Failure, Place, Row};
use super::summary::Summary;
use super::tally::Tally;
use crate::formats::rollouts::RolloutRecord;
use crate::metrics::Options;
use crate::rollout::Rollout;
use crate::scene::Scenario;

/// Recorded rollouts, which are scored scenario by scenario in the order in which scenarios are read.
#[derive(Debug)]
pub struct Recorded {
    records: BTreeMap<String, Vec<RolloutRecord>>,
    tally: Tally,
    failures: Vec<Failure>,
    findings: Findings,
    options: Options,
}

impl Recorded {
    /// Takes recorded rollouts. Simulators are in the order of their first rollout.
    pub fn new(rollouts: Vec<RolloutRecord>, options: Options) -> Self {
        let mut simulators: Vec<String> = Vec::new();
        let mut records: BTreeMap<String, Vec<RolloutRecord>> = BTreeMap::new();
        for record in rollouts {
            if !simulators.contains(&record.simulator) {
                simulators.push(record.simulator.clone());
            }
            records.entry(record.scenario_id.clone()).or_default().push(record);
        }
        Self {
            records,
            tally: Tally::new(simulators, 1),
            failures: Vec::new(),
            findings: Findings::default(),
            options,
        }
    }

    /// Scores all rollouts of a scenario and returns the failures. A scenario without rollouts is skipped.
    pub fn score(&mut self, place: Place, file: &str, scenario: &Scenario) -> Vec<Failure> {
        let mut failed = Vec::new();
        let mut groups: BTreeMap<String, Vec<RolloutRecord>> = BTreeMap::new();
        for record in self.records.remove(&scenario.id).unwrap_or_default() {
            groups.entry(record.simulator.clone()).or_default().push(record);
        }
        for simulator in self.tally.simulators.iter().filter(|s| !groups.contains_key(*s)) {
            self.findings.add(RolloutCheck::Coverage, || {
                format!("scenario `{}` has no rollout of `{simulator}`", scenario.id)
            });
        }
        for (simulator, mut records) in groups {
            records.sort_by_key(|r| r.rollout);
            for record in &records {
                // Tracks that do not fit are reported with the scores.
                if let Ok(tracks) = recorded_tracks(scenario, record) {
                    let place =
                        format!("scenario `{}`, `{simulator}`, rollout {}", scenario.id, record.rollout);
                    rollout_checks::check(scenario, &place, &tracks, &mut self.findings);
                }
            }
            let rows = score_records(place, scenario, &simulator, &records, self.options);
            match rows {
                Ok(rows) => self.tally.add(&rows),
                Err(error) => failed.push(Failure {
                    input: place.input,
                    record: place.record,
                    simulator: Some(simulator),
                    file: file.to_owned(),
                    scenario: Some(scenario.id.clone()),
                    error: format!("scenario `{}`: {error}", scenario.id),
                }),
            }
        }
        self.failures.extend(failed.iter().cloned());
        failed
    }

    /// Returns the rollouts that fail checks.
    pub fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Returns the ids of the scenarios whose rollouts are not yet scored.
    pub fn left(&self) -> impl Iterator<Item = &str> {
        self.records.keys().map(String::as_str)
    }

    /// Returns the provenance records of the simulators, of which only the names are known.
    pub fn simulators(&self) -> Vec<SimulatorRecord> {
        let record = |id: &String| SimulatorRecord {
            id: id.clone(),
            title: id.clone(),
            oracle: false,
            card: String::new(),
            parameters: BTreeMap::new(),
            weights: None,
            external: None,
        };
        self.tally.simulators.iter().map(record).collect()
    }

    /// Summarizes the scores. `failures`: further failures, such as scenarios that cannot be read.
    pub fn finish(self, failures: Vec<Failure>, provenance: &Provenance) -> Summary {
        let mut all = self.failures;
        all.extend(failures);
        all.sort();
        Summary::new(&self.tally, &all, provenance)
    }
}

/// Returns the rows of the recorded rollouts of one scenario and one simulator, in the order of the rollouts.
pub(super) fn score_records(
    place: Place,
    scenario: &Scenario,
    simulator: &str,
    records: &[RolloutRecord],
    options: Options,
) -> Result<Vec<Row>, String> {
    if let Some(pair) = records.windows(2).find(|w| w[0].rollout == w[1].rollout) {
        return Err(format!("rollout {} occurs twice", pair[0].rollout));
    }
    let rollouts = records.iter().map(|record| {
        let tracks = recorded_tracks(scenario, record);
        let tracks = tracks.map_err(|e| format!("rollout {}: {e}", record.rollout))?;
        Ok(Rollout { tracks, outcomes: BTreeMap::new() })
    });
    let rollouts: Vec<Rollout> = rollouts.collect::<Result<_, String>>()?;
    let deviation = scenario.deviation.as_ref().map(KnownDeviation::of).unwrap_or_default();
    let template = Row::about(place, scenario, scenario.digest(), simulator).with_deviation(&deviation);
    let indices = records.iter().map(|r| r.rollout);
    let scores = judge(scenario, deviation.certificate.as_ref(), &rollouts, options);
    let rows = scores.rows(template, indices, &rollouts);
    Ok(rows.into_iter().map(|(row, _)| row).collect())
}
