//! Scenarios of a command.

use std::fmt::Display;

use super::{say, warn_passed_over};
use crate::evaluation::{Deviations, Opening, ScenarioSpec, Selection, Source};
use crate::scene::Scenario;

/// Finds the files of scenarios and recognises their formats.
pub(super) fn sources(input: &ScenarioSpec, opening: Opening) -> anyhow::Result<Vec<Source>> {
    let (sources, passed_over) = input.open(opening)?;
    warn_passed_over(passed_over);
    Ok(sources)
}

/// Finds the files and reads the file of deviations, to go through the selected scenarios.
pub(super) fn select(input: &ScenarioSpec) -> anyhow::Result<SelectedScenarios> {
    let sources = sources(input, Opening::Whole)?;
    let deviations = input.deviations.as_deref().map(Deviations::read).transpose()?;
    Ok(SelectedScenarios { sources, selection: input.selection.selection(), deviations })
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
