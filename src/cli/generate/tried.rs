//! Scenarios that were generated and curated in partitions, read back for the choice of a benchmark.

use std::path::{Path, PathBuf};

use super::bench::{SOURCE, curation_settings};
use super::scenario_file::{ScenarioFile, read_scenarios};
use crate::curation::benchmark::TriedScenario;
use crate::curation::outcomes::{OutcomeReader, OutcomeWriter, RecordOutcome};
use crate::curation::{CurationOutcome, CurationSettings, curate_scenario};
use crate::formats::{FormatError, Scenarios};
use crate::generation::{GenerationError, GenerationSettings};
use crate::scene::Scenario;

/// A scenario with its candidates, or the reason why it could not be generated.
pub(super) type Tried = (Option<Scenario>, RecordOutcome);

/// Curates generated scenarios for a benchmark.
pub(super) struct Trial {
    curation: CurationSettings,
}

impl Trial {
    pub(super) fn new(settings: &GenerationSettings) -> Self {
        Self { curation: curation_settings(settings) }
    }

    /// Curates a scenario up to the choice. It is kept if any of its candidates can be chosen.
    pub(super) fn of(&self, generated: Result<Scenario, GenerationError>) -> Tried {
        match generated {
            Err(error) => (None, RecordOutcome::Failed { error: error.to_string(), scenario: None }),
            Ok(scenario) => {
                let outcome = curate_scenario(&scenario, SOURCE, &self.curation);
                let keep = can_be_chosen(&outcome);
                let (id, source) = (scenario.id.clone(), scenario.source.clone());
                (keep.then_some(scenario), RecordOutcome::Curated { scenario: id, source, outcome })
            }
        }
    }
}

fn can_be_chosen(outcome: &CurationOutcome) -> bool {
    match outcome {
        CurationOutcome::Rejected { .. } => false,
        CurationOutcome::Retained(record, _) => record.candidates.iter().any(|c| c.rejected_by.is_none()),
    }
}

/// Writes the scenarios of a partition with their outcomes.
pub(super) struct TriedWriter {
    scenarios: ScenarioFile,
    outcomes: OutcomeWriter,
}

impl TriedWriter {
    pub(super) fn create(folder: &Path) -> Result<Self, FormatError> {
        Ok(Self { scenarios: ScenarioFile::new(folder), outcomes: OutcomeWriter::create(folder)? })
    }

    /// Writes the scenario with this index. Returns whether it is a failure.
    pub(super) fn write(&mut self, index: usize, (scenario, outcome): Tried) -> Result<bool, FormatError> {
        if let Some(scenario) = scenario {
            self.scenarios.write(&scenario)?;
        }
        self.outcomes.write((0, index), outcome)
    }

    /// Completes the files.
    pub(super) fn finish(self) -> Result<(), FormatError> {
        self.outcomes.finish()?;
        self.scenarios.finish()
    }
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
