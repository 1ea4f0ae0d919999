//! Scenarios and logs that commands read.

use std::fmt::Display;
use std::path::PathBuf;

use super::output::say;
use crate::evaluation::realism::LogSource;
use crate::evaluation::{AvChoice, Deviations, Opening, ReadingSpec, ScenarioSpec, Selection, Source};
use crate::formats::{Input, PassedOver};
use crate::scene::{DeviatedTrack, Scenario};

/// Finds the scenario files at all paths and recognises their formats. Warns of files that have the
/// name of a scenario file only.
pub(super) fn find_inputs(paths: &[PathBuf]) -> anyhow::Result<Vec<Input>> {
    inputs_of(&ReadingSpec::default(), paths)
}

/// Warns of files that have the name of a scenario file only.
pub(super) fn warn_passed_over(files: PassedOver) {
    for (file, reason) in files {
        say(format_args!("warning: {} is skipped: {reason}", file.display()));
    }
}

/// Finds inputs as [`find_inputs`], and sets how they are read.
pub(super) fn inputs_of(reading: &ReadingSpec, paths: &[PathBuf]) -> anyhow::Result<Vec<Input>> {
    let (inputs, passed_over) = reading.find_inputs(paths)?;
    warn_passed_over(passed_over);
    Ok(inputs)
}

/// Finds the files of scenarios and recognises their formats. A limit counts those that are run with this AV
/// policy.
pub(super) fn sources(
    input: &ScenarioSpec,
    opening: Opening,
    av: Option<&AvChoice>,
) -> anyhow::Result<Vec<Source>> {
    let (sources, passed_over) = input.open(opening, av)?;
    warn_passed_over(passed_over);
    Ok(sources)
}

/// Finds the files and reads the file of deviations, to go through the selected scenarios.
pub(super) fn select(input: &ScenarioSpec) -> anyhow::Result<SelectedScenarios> {
    let sources = sources(input, Opening::Whole, None)?;
    let deviations = input.deviations.as_deref().map(Deviations::read).transpose()?;
    Ok(SelectedScenarios { sources, selection: input.selection.selection(), deviations })
}

/// The selected scenarios of a command.
pub(super) struct SelectedScenarios {
    sources: Vec<Source>,
    selection: Selection,
    /// The file of deviated AVs, if one is given.
    deviations: Option<Deviations>,
}

impl SelectedScenarios {
    /// Passes every selected scenario to `visit`; of a file of deviations, those that it has, with the
    /// deviated AVs there. Files and scenarios that cannot be read are warnings; returns their number.
    ///
    /// # Errors
    /// The first error of `visit`.
    pub(super) fn each<E>(&self, mut visit: impl FnMut(Scenario) -> Result<(), E>) -> Result<usize, E> {
        let mut failed = 0;
        let deviations = self.deviations.as_ref().map(|deviations| &deviations.tracks);
        let mut fail = |error: &dyn Display| {
            say(format_args!("warning: {error}"));
            failed += 1;
        };
        for source in &self.sources {
            let scenarios = match source.scenarios() {
                Ok(scenarios) => scenarios,
                Err(error) => {
                    fail(&error);
                    continue;
                }
            };
            for scenario in scenarios {
                match scenario {
                    Ok(mut scenario) if self.selection.has(&scenario, deviations, false) => {
                        if let Some(record) = deviations.and_then(|all| all.get(&scenario.id)) {
                            scenario.deviation = Some(DeviatedTrack {
                                category: record.category,
                                track: record.track_in(scenario.origin),
                                certificate: record.certificate_in(scenario.origin),
                            });
                        }
                        visit(scenario)?;
                    }
                    Ok(_) => {}
                    Err(error) => fail(&error),
                }
            }
        }
        Ok(failed)
    }
}

/// Returns the sources of logs as they were recorded, as far as files are recordings of the Waymo Open Motion
/// Dataset; the shipped scenarios without paths.
pub(super) fn recorded_logs(paths: &[PathBuf]) -> anyhow::Result<Vec<LogSource>> {
    if paths.is_empty() {
        return Ok(vec![LogSource::Shipped]);
    }
    let mut sources = Vec::new();
    for path in paths {
        if LogSource::is_message(path) {
            sources.push(LogSource::Recording(path.clone()));
        } else {
            sources.extend(find_inputs(std::slice::from_ref(path))?.into_iter().map(LogSource::of));
        }
    }
    Ok(sources)
}

/// Returns the sources of logs with the agents that a run simulates: recordings as they are if these are all,
/// at the current frame that they state and with the length of the benchmark.
pub(super) fn simulated_logs(paths: &[PathBuf], reading: &ReadingSpec) -> anyhow::Result<Vec<LogSource>> {
    let as_recorded = reading.has_all_agents() && reading.has_stated_frames();
    if reading.is_shipped(paths) || as_recorded && reading.nuplan.filter.is_none() {
        return recorded_logs(paths);
    }
    Ok(inputs_of(reading, paths)?.into_iter().map(LogSource::Scenarios).collect())
}
