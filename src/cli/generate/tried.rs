//! Scenarios that were generated and curated in partitions, read back for the choice of a benchmark.

use std::path::{Path, PathBuf};

use super::bench::SOURCE;
use super::scenario_file::read_scenarios;
use crate::curation::benchmark::TriedScenario;
use crate::curation::outcomes::{OutcomeReader, RecordOutcome};
use crate::curation::{CurationOutcome, CurationSettings, curate_scenario};
use crate::formats::{FormatError, Scenarios};
use crate::generation::GenerationError;
use crate::scene::Scenario;

/// Curates a generated scenario up to the choice. It is kept if any of its candidates can be chosen.
pub(super) fn curated(
    generated: Result<Scenario, GenerationError>,
    settings: &CurationSettings,
) -> (Option<Scenario>, RecordOutcome) {
    match generated {
        Err(error) => (None, RecordOutcome::Failed { error: error.to_string(), scenario: None }),
        Ok(scenario) => {
            let outcome = curate_scenario(&scenario, SOURCE, settings);
            let keep = can_be_chosen(&outcome);
            let (id, source) = (scenario.id.clone(), scenario.source.clone());
            (keep.then_some(scenario), RecordOutcome::Curated { scenario: id, source, outcome })
        }
    }
}

fn can_be_chosen(outcome: &CurationOutcome) -> bool {
    matches!(outcome, CurationOutcome::Retained(record, _)
        if record.candidates.iter().any(|candidate| candidate.rejected_by.is_none()))
}

/// Reads the scenarios of all partitions, whose folders are in order.
pub(super) fn read_tried(
    folders: &[PathBuf],
) -> impl Iterator<Item = Result<Result<TriedScenario, String>, FormatError>> {
    folders.iter().flat_map(|folder| -> Box<dyn Iterator<Item = _>> {
        match TriedReader::open(folder) {
            Ok(tried) => Box::new(tried),
            Err(error) => Box::new(std::iter::once(Err(error))),
        }
    })
}

/// Iterator over the scenarios of a partition.
struct TriedReader {
    scenarios: Scenarios,
    outcomes: OutcomeReader,
}

impl TriedReader {
    fn open(folder: &Path) -> Result<Self, FormatError> {
        Ok(Self { scenarios: read_scenarios(folder)?, outcomes: OutcomeReader::open(folder)? })
    }

    fn tried(&mut self, outcome: RecordOutcome) -> Result<Result<TriedScenario, String>, FormatError> {
        Ok(match outcome {
            RecordOutcome::Failed { error, .. } => Err(error),
            RecordOutcome::Repeated { scenario } => Err(format!("{scenario}: its id was generated before")),
            RecordOutcome::Curated { source, outcome, .. } => {
                let kept = can_be_chosen(&outcome).then(|| self.scenarios.next()).flatten();
                Ok(TriedScenario { source, scenario: kept.transpose()?, outcome: Some(outcome) })
            }
        })
    }
}

impl Iterator for TriedReader {
    type Item = Result<Result<TriedScenario, String>, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        let outcome = self.outcomes.next()?;
        Some(outcome.and_then(|(_, outcome)| self.tried(outcome)))
    }
}
