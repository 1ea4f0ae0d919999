//! Scores of rollout files from any program.

pub(crate) mod recorded_rollouts;
pub(crate) mod in_memory;
pub mod document;

use std::path::{Path, PathBuf};

use reactsim_formats as formats;
use reactsim_formats::Input;
use reactsim_metrics::Options;
use reactsim_rollout::Entering;
use reactsim_scene::Scenario;

use crate::deviation::pose::Pose;
use crate::error::EvaluationError;
use crate::folder::rollouts::write_part;
use crate::folder::{RunFolder, read_provenance};
use crate::layout::{PROVENANCE, ROLLOUTS};
use crate::motion::kind::RolloutCheck;
use crate::plan::{Deviations, NoAv};
use crate::provenance::named_options;
use crate::provenance::{Provenance, SettingsRecord, program_commit, program_version};
use crate::row::{Failure, RecordPosition};
use crate::runner::RunObserver;
use crate::scoring::recorded_rollouts::{RecordedRollouts, ScoredPair};
use crate::simulators::record::SimulatorRecord;
use crate::source::benchmarks::BenchmarkRecord;
use crate::source::file_record::{FileRecord, Registrar};
use crate::summary::Summary;

/// Rollout files to be scored against their scenarios, read and described before the first scenario.
pub struct Scoring {
    recorded: RecordedRollouts,
    scenarios: Vec<Input>,
    provenance: Provenance,
    /// Deviated AVs in place of those that the scenarios carry.
    deviations: Option<Deviations>,
    /// Rollouts that cannot be read.
    failures: Vec<Failure>,
}

impl Scoring {
    /// Reads rollouts in Parquet and the digests of their scenario files. `pose`: the point of vehicles whose
    /// poses they are.
    ///
    /// # Errors
    /// [`EvaluationError`] if a file cannot be read. Single rollouts that cannot be read become failures of
    /// the run.
    pub fn new(
        rollouts: &[PathBuf],
        scenarios: &[Input],
        options: Options,
        pose: Pose,
    ) -> Result<Self, EvaluationError> {
        let (mut failures, mut records, mut files) = (Vec::new(), Vec::new(), Vec::new());
        for (input, path) in rollouts.iter().enumerate() {
            let file = FileRecord::of(path, "rollouts")?;
            for (record, rollout) in formats::rollouts::read(path)?.enumerate() {
                match rollout {
                    Ok(rollout) => records.push(rollout),
                    Err(error) => {
                        let place = RecordPosition { input, record };
                        failures.push(Failure::new(place, &file, error.scenario.clone(), error));
                    }
                }
            }
            files.push(file);
        }
        let mut registrar = Registrar::default();
        for input in scenarios {
            files.push(registrar.record(input)?);
        }
        let entering = entering_of(rollouts)?;
        let recorded = RecordedRollouts::new(records, options, pose, entering);
        let benchmark = match &files[rollouts.len()..] {
            [scenarios] => BenchmarkRecord::of(scenarios),
            _ => None,
        };
        let provenance = Provenance {
            version: program_version().to_owned(),
            commit: program_commit().to_owned(),
            settings: SettingsRecord {
                pose: SettingsRecord::pose(pose),
                entering: SettingsRecord::entering(entering),
                ..SettingsRecord::recorded(u32::try_from(recorded.rollouts()).unwrap_or(u32::MAX))
            },
            metric_options: named_options(&options),
            simulators: recorded.simulators().iter().map(|name| SimulatorRecord::named(name, name)).collect(),
            // The rollout files first, then the scenario files.
            inputs: files,
            benchmark,
            keep_rollouts: Some(true),
            ..Provenance::default()
        };
        Ok(Self { recorded, scenarios: scenarios.to_vec(), provenance, deviations: None, failures })
    }

    /// Takes the deviated AVs from a file, as the run did that made the rollouts.
    #[must_use]
    pub fn deviations(mut self, deviations: Deviations) -> Self {
        self.provenance.deviations = Some(deviations.file.clone());
        self.provenance.benchmark = None;
        self.deviations = Some(deviations);
        self
    }

    /// Returns the provenance of the scores.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// Scores all rollouts. With a folder, rows, events and rollouts are written to it as those of a run.
    /// Failures are passed to the observer and listed in the summary; everything else is scored. Checks that
    /// need not be met are `allowed`; the summary states how many rollouts fail them.
    ///
    /// # Errors
    /// [`EvaluationError`] if a scenario file cannot be opened, the folder cannot be written, or rollouts
    /// fail a check that is not allowed.
    pub fn run(
        mut self,
        allowed: &[RolloutCheck],
        folder: Option<&RunFolder>,
        observer: &dyn RunObserver,
    ) -> Result<Summary, EvaluationError> {
        let mut tally = self.provenance.tally();
        let first_scenarios = self.provenance.inputs.len() - self.scenarios.len();
        for (input, scenarios) in (first_scenarios..).zip(&self.scenarios) {
            let file = &self.provenance.inputs[input];
            for (record, scenario) in scenarios.open()?.enumerate() {
                let place = RecordPosition { input, record };
                let mut scenario = match scenario {
                    Ok(scenario) => scenario,
                    Err(error) => {
                        self.failures.push(Failure::new(place, file, error.scenario.clone(), error));
                        continue;
                    }
                };
                // Rows have the digest of the scenario in its file.
                let digest = self.deviations.as_ref().map(|_| scenario.digest());
                match self.deviations.as_ref().map(|deviations| deviations.of(&scenario)) {
                    None => {}
                    Some(Ok(deviated)) => scenario.deviation = Some(deviated),
                    Some(Err(NoAv::Missing)) => scenario.deviation = None,
                    Some(Err(error)) => {
                        self.failures.push(Failure::new(place, file, Some(scenario.id), error));
                        continue;
                    }
                }
                let digest = || digest.clone().unwrap_or_else(|| scenario.digest());
                for pair in self.recorded.score(place, &scenario, digest) {
                    match pair {
                        Ok(pair) => {
                            keep(&pair, place, &scenario, folder)?;
                            observer.rows(&pair.rows);
                            tally.add(&pair.rows);
                        }
                        Err((simulator, error)) => {
                            let error = format!("scenario `{}`: {error}", scenario.id);
                            let failure = Failure::new(place, file, Some(scenario.id.clone()), error);
                            self.failures.push(Failure { simulator: Some(simulator), ..failure });
                        }
                    }
                }
            }
        }
        self.recorded.findings().check(allowed)?;
        if let Some(file) = self.provenance.inputs.first() {
            let unmatched = self.recorded.left().map(|id| {
                let error = format!("no scenario `{id}` is given for its rollouts");
                Failure::new(RecordPosition { input: 0, record: 0 }, file, Some(id.to_owned()), error)
            });
            self.failures.extend(unmatched);
        }
        self.failures.sort();
        self.failures.iter().for_each(|failure| observer.failed(failure));
        let mut summary = Summary::new(&tally, &self.failures, &self.provenance);
        // Scenarios without rollouts have no rows to be marked.
        let absent = self.recorded.findings().iter().filter(|(check, ..)| *check == RolloutCheck::Coverage);
        summary.provenance.allowed.extend(absent.map(|(check, n, _)| (check.allowance().to_owned(), n)));
        if let Some(folder) = folder {
            folder.complete(&tally, &self.failures, &summary, true)?;
        }
        Ok(summary)
    }
}

/// Writes the scores and the rollouts of a scenario and a simulator.
fn keep(
    pair: &ScoredPair,
    place: RecordPosition,
    scenario: &Scenario,
    folder: Option<&RunFolder>,
) -> Result<(), EvaluationError> {
    let (Some(folder), Some(row)) = (folder, pair.rows.first()) else { return Ok(()) };
    write_part(&folder.part(place, pair.simulator)?, scenario, &row.simulator, &pair.rollouts)?;
    folder.append(&pair.rows, &pair.events)
}

/// Returns whether agents entered in these rollouts. A run states it in the folder with its rollouts;
/// rollouts of other programs have no such agents.
fn entering_of(rollouts: &[PathBuf]) -> Result<Entering, EvaluationError> {
    let mut found = None;
    for path in rollouts {
        let folder = path.parent().unwrap_or(Path::new(""));
        let is_kept = path.file_name().is_some_and(|name| name == ROLLOUTS);
        let stated = match is_kept && folder.join(PROVENANCE).exists() {
            true => read_provenance(folder)?.settings.entering,
            false => None,
        };
        let entering =
            stated.map_or(Ok(Entering::Off), |text| text.parse()).map_err(EvaluationError::Refused)?;
        if found.is_some_and(|other| other != entering) {
            let text = "agents enter in some of these rollouts and not in others: score them separately";
            return Err(EvaluationError::Refused(text.to_owned()));
        }
        found = Some(entering);
    }
    Ok(found.unwrap_or_default())
}
