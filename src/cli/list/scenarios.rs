//! `reactsim list scenarios`: the scenarios of files.

use super::super::inputs::select;
use crate::evaluation::Deviations;
use crate::evaluation::ScenarioSpec;
use crate::scene::Scenario;

/// Text of a property that a scenario does not have.
const NONE: &str = "-";

/// Returns a row per selected scenario below a row of headings, and the number of scenarios that cannot be
/// read.
pub(super) fn rows(args: &ScenarioSpec) -> anyhow::Result<(Vec<Vec<String>>, usize)> {
    let selected = select(args)?;
    let headings = ["scenario_id", "source", "agents", "category", "difficulty"].map(str::to_owned);
    let mut rows = vec![headings.to_vec()];
    let failed = selected.each(|scenario| {
        rows.push(row(&scenario, selected.deviations.as_ref()));
        anyhow::Ok(())
    })?;
    Ok((rows, failed))
}

fn row(scenario: &Scenario, deviations: Option<&Deviations>) -> Vec<String> {
    let (category, certificate) = match deviations {
        Some(deviations) => {
            let record = deviations.tracks.get(&scenario.id);
            (record.and_then(|r| r.category), record.and_then(|r| r.certificate.as_ref()))
        }
        None => {
            let own = scenario.deviation.as_ref();
            (own.and_then(|d| d.category), own.and_then(|d| d.certificate.as_ref()))
        }
    };
    let difficulty = certificate.and_then(|certificate| certificate.difficulty());
    vec![
        scenario.id.clone(),
        scenario.source.clone(),
        scenario.start.agents.len().to_string(),
        category.map_or(NONE, |category| category.name()).to_owned(),
        difficulty.map_or(NONE, |difficulty| difficulty.name()).to_owned(),
    ]
}
