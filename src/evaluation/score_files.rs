//! Scores of rollout files from any program.

use std::path::PathBuf;

use super::{
    BenchmarkRecord, EvaluationError, Failure, FileRecord, Place, Provenance, Recorded, Registrar,
    RolloutCheck, RunObserver, SettingsRecord, Summary, program_commit, program_version,
};
use crate::formats::{self, Input};
use crate::metrics::Options;

/// Scores the rollouts in Parquet files against their scenarios. Failures are passed to the observer and
/// listed in the summary; everything else is scored. Checks that need not be met are `allowed`; the summary
/// states how many rollouts fail them.
///
/// # Errors
/// [`EvaluationError`] if a file cannot be opened, or rollouts fail a check that is not allowed.
pub fn score_files(
    rollouts: &[PathBuf],
    scenarios: &[Input],
    options: Options,
    allowed: &[RolloutCheck],
    observer: &dyn RunObserver,
) -> Result<Summary, EvaluationError> {
    let (mut failures, mut records, mut files) = (Vec::new(), Vec::new(), Vec::new());
    for (input, path) in rollouts.iter().enumerate() {
        let file = FileRecord::of(path, "rollouts")?;
        for (record, rollout) in formats::rollouts::read(path)?.enumerate() {
            match rollout {
                Ok(rollout) => records.push(rollout),
                Err(error) => {
                    failures.push(failure(input, record, &file.name, error.scenario.clone(), error))
                }
            }
        }
        files.push(file);
    }
    let mut recorded = Recorded::new(records, options);
    let mut registrar = Registrar::default();
    for (i, scenarios) in scenarios.iter().enumerate() {
        let (input, file) = (rollouts.len() + i, registrar.record(scenarios)?);
        for (record, scenario) in scenarios.open()?.enumerate() {
            match scenario {
                Ok(scenario) => {
                    for failure in recorded.score(Place { input, record }, &file.name, &scenario) {
                        observer.failed(&failure);
                    }
                }
                Err(error) => {
                    failures.push(failure(input, record, &file.name, error.scenario.clone(), error))
                }
            }
        }
        files.push(file);
    }
    if let Some(findings) = recorded.findings().refused(allowed) {
        return Err(EvaluationError::RolloutsRefused { findings });
    }
    let allowed = recorded.findings().iter().map(|(check, n, _)| (check.allowance().to_owned(), n)).collect();
    let name = files.first().map_or("", |file| file.name.as_str());
    let unmatched = recorded.left().map(|id| {
        let error = format!("no scenario `{id}` in --scenarios for its rollouts");
        failure(0, 0, name, Some(id.to_owned()), error)
    });
    failures.extend(unmatched);
    failures.iter().for_each(|failure| observer.failed(failure));
    let benchmark = match &files[rollouts.len()..] {
        [scenarios] => BenchmarkRecord::of(scenarios),
        _ => None,
    };
    let provenance = Provenance {
        version: program_version().to_owned(),
        commit: program_commit().to_owned(),
        settings: SettingsRecord::recorded(),
        metric_options: options.named().into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        simulators: recorded.simulators(),
        // The rollout files first, then the scenario files.
        inputs: files,
        deviations: None,
        benchmark,
        backend: None,
        cpu: None,
        keep_rollouts: None,
    };
    let mut summary = recorded.finish(failures, &provenance);
    summary.provenance.allowed = allowed;
    Ok(summary)
}

fn failure(
    input: usize,
    record: usize,
    file: &str,
    scenario: Option<String>,
    error: impl ToString,
) -> Failure {
    Failure { input, record, simulator: None, file: file.to_owned(), scenario, error: error.to_string() }
}
