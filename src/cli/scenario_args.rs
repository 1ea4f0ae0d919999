//! Arguments that name scenarios and their deviated AVs.

use std::fmt::Display;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;

use super::{ReadingArgs, say};
use crate::evaluation::{Deviations, Selection, Source};
use crate::formats::Partition;
use crate::scene::{Deviation, Scenario};

/// Scenarios of a command, by default those of the shipped benchmark.
#[derive(Debug, Args)]
pub(super) struct ScenarioArgs {
    /// Files, folders or URLs of scenarios [default: the shipped benchmark]
    #[arg(value_name = "SCENARIOS")]
    pub(super) scenarios: Vec<PathBuf>,
    /// Deviated AVs by scenario id, Parquet or JSON, also a URL; other scenarios are skipped
    #[arg(long, value_name = "FILE")]
    pub(super) deviations: Option<PathBuf>,
    /// Only the first N scenarios of every file [default: all]
    #[arg(long, value_name = "N")]
    pub(super) limit: Option<NonZeroUsize>,
    #[command(flatten)]
    pub(super) selection: SelectionArgs,
    #[command(flatten)]
    pub(super) reading: ReadingArgs,
}

/// Scenarios by id and category.
#[derive(Debug, Args)]
pub(super) struct SelectionArgs {
    /// Only the scenario with this id; may be repeated
    #[arg(long = "id", value_name = "ID")]
    ids: Vec<String>,
    /// Only scenarios whose deviated AV has this category; may be repeated
    #[arg(long = "category", value_name = "CATEGORY", value_delimiter = ',',
          value_parser = Deviation::ALL.map(Deviation::name))]
    categories: Vec<String>,
}

impl SelectionArgs {
    pub(super) fn selection(&self) -> Selection {
        let (ids, categories) = (&self.ids, &self.categories);
        Selection { ids: ids.iter().cloned().collect(), categories: categories.iter().cloned().collect() }
    }
}

impl ScenarioArgs {
    /// Finds the files of scenarios, of which a partition may be run, and recognises their formats.
    pub(super) fn sources(&self, partition: Option<Partition>) -> anyhow::Result<Vec<Source>> {
        if self.is_shipped() {
            self.reading.check_absent()?;
            return Ok(vec![Source::shipped(self.most())]);
        }
        let inputs = self.reading.find_inputs(&self.scenarios)?;
        Ok(match partition {
            Some(partition) => Source::of_partition(inputs, self.most(), partition)?,
            None => Source::of_inputs(inputs, self.most())?,
        })
    }

    /// Finds the files of scenarios, which are not read for their digests.
    pub(super) fn unread_sources(&self) -> anyhow::Result<Vec<Source>> {
        if self.is_shipped() {
            return self.sources(None);
        }
        Ok(Source::unread(self.reading.find_inputs(&self.scenarios)?, self.most()))
    }

    fn is_shipped(&self) -> bool {
        self.reading.is_shipped(&self.scenarios)
    }

    /// Returns the largest number of scenarios of a file.
    fn most(&self) -> usize {
        self.limit.map_or(usize::MAX, NonZeroUsize::get)
    }

    /// Finds the files and reads the file of deviations, to go through the selected scenarios.
    pub(super) fn selected(&self) -> anyhow::Result<SelectedScenarios> {
        let sources = self.sources(None)?;
        let deviations = self.deviations.as_deref().map(Deviations::read).transpose()?;
        Ok(SelectedScenarios { sources, selection: self.selection.selection(), deviations })
    }
}

/// The selected scenarios of a command.
pub(super) struct SelectedScenarios {
    sources: Vec<Source>,
    selection: Selection,
    /// The file of deviated AVs, if one is given.
    pub(super) deviations: Option<Deviations>,
}

impl SelectedScenarios {
    /// Passes every selected scenario to `visit`. Files and scenarios that cannot be read are warnings;
    /// returns their number.
    ///
    /// # Errors
    /// The first error of `visit`.
    pub(super) fn each<E>(&self, mut visit: impl FnMut(Scenario) -> Result<(), E>) -> Result<usize, E> {
        let mut failed = 0;
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
                    Ok(scenario) => {
                        if is_selected(&scenario, &self.selection, self.deviations.as_ref()) {
                            visit(scenario)?;
                        }
                    }
                    Err(error) => fail(&error),
                }
            }
        }
        Ok(failed)
    }
}

/// Returns whether a scenario is selected; its category is that in the file of deviations, if there is one.
pub(super) fn is_selected(
    scenario: &Scenario,
    selection: &Selection,
    deviations: Option<&Deviations>,
) -> bool {
    let own = scenario.deviation.as_ref().and_then(|d| d.category);
    let listed = |d: &Deviations| d.tracks.get(&scenario.id).and_then(|record| record.category);
    selection.has_id(&scenario.id) && selection.has_category(deviations.map_or(own, listed))
}
