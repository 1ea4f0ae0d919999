//! `reactsim list parameters`: the parameters of a card, with units and ranges.

use anyhow::bail;

use crate::evaluation::suggestion::did_you_mean;
use crate::models::{MODELS, Setup, find, qp};

/// Id of the stage that can follow a simulator.
const STAGE: &str = "qp";

/// Returns a row per parameter below a row of headings.
pub(super) fn rows(id: &str) -> anyhow::Result<Vec<Vec<String>>> {
    let setup = setup(id)?;
    let parameters = setup.parameters.ranges()?;
    if parameters.is_empty() {
        bail!("the simulator `{id}` has no parameters");
    }
    let headings = ["parameter", "value", "unit", "range", "description"].map(str::to_owned).to_vec();
    let row = |(key, value, range): (String, &toml::Value, &crate::models::ParameterRange)| {
        vec![key, value.to_string(), range.unit.clone(), range.allowed.to_string(), range.about.clone()]
    };
    Ok(std::iter::once(headings).chain(parameters.into_iter().map(row)).collect())
}

/// Returns the setup of a simulator, or that of the stage.
fn setup(id: &str) -> anyhow::Result<Setup> {
    if let Some(model) = find(id) {
        return Ok(model.setup()?);
    }
    if id == STAGE {
        return Ok(Setup::new(STAGE, qp::CARD, qp::RANGES, None)?);
    }
    let known: Vec<&str> =
        MODELS.iter().filter(|m| !m.ranges.is_empty()).map(|m| m.id).chain([STAGE]).collect();
    let meant = did_you_mean(id, known.iter().copied());
    bail!("there is no simulator `{id}`; those with parameters are {}{meant}", known.join(", "))
}
