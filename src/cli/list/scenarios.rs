//! `reactsim list scenarios`: the scenarios of files.

use super::super::inputs::select;
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
        rows.push(row(&scenario));
        anyhow::Ok(())
    })?;
    Ok((rows, failed))
}

fn row(scenario: &Scenario) -> Vec<String> {
    let deviation = scenario.deviation.as_ref();
    let category = deviation.and_then(|deviation| deviation.category);
    let difficulty = deviation.and_then(|deviation| deviation.certificate.as_ref()?.difficulty());
    vec![
        scenario.id.clone(),
        scenario.source.clone(),
        scenario.start.agents.len().to_string(),
        category.map_or(NONE, |category| category.name()).to_owned(),
        difficulty.map_or(NONE, |difficulty| difficulty.name()).to_owned(),
    ]
}
