//! Scenarios that were generated and curated in partitions, read back for the choice of a benchmark.

use std::path::{Path, PathBuf};

use super::bench::SOURCE;
use super::scenario_file::read_scenarios;
use crate::curation::benchmark::TriedScenario;
use crate::curation::outcomes::{OutcomeReader, RecordOutcome};
use crate::curation::{CurationOutcome, CurationSettings, curate_scenario};
use crate::formats::FormatError;
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
        match tried(folder) {
            Ok(tried) => Box::new(tried),
            Err(error) => Box::new(std::iter::once(Err(error))),
        }
    })
}

/// Reads the scenarios of a partition.
fn tried(
    folder: &Path,
) -> Result<impl Iterator<Item = Result<Result<TriedScenario, String>, FormatError>> + use<>, FormatError> {
    let (mut scenarios, outcomes) = (read_scenarios(folder)?, OutcomeReader::open(folder)?);
    Ok(outcomes.map(move |outcome| {
        Ok(match outcome?.1 {
            RecordOutcome::Failed { error, .. } => Err(error),
            RecordOutcome::Repeated { scenario } => Err(format!("{scenario}: its id was generated before")),
            RecordOutcome::Curated { source, outcome, .. } => {
                let kept = can_be_chosen(&outcome).then(|| scenarios.next()).flatten();
                Ok(TriedScenario { source, scenario: kept.transpose()?, outcome: Some(outcome) })
            }
        })
    }))
}
