//! Scenarios whose logged future is replaced by a deviated AV and the responses of its certificate.

use std::path::Path;

use anyhow::{Context, bail};

use super::futures::replace_future;
use crate::evaluation::Deviations;
use crate::scene::{AgentState, Certificate, Frame, Scenario};

/// Name that takes the place of a simulator in the ids of the scenarios.
const NAME: &str = "certificate";

/// Reads a file of deviations. At least one of them must have a certificate.
pub(super) fn open(path: &Path) -> anyhow::Result<Deviations> {
    let deviations = Deviations::read(path)?;
    if deviations.tracks.values().all(|record| record.certificate.is_none()) {
        bail!("{}: no deviation has a certificate: take a file that `curate` wrote", path.display());
    }
    Ok(deviations)
}

/// Lets the AV follow its deviation and each agent its response; agents without a response keep their log.
/// Appends `certificate` to the id. Returns `false` if there is no certificate for the scenario.
pub(super) fn put_into(deviations: &Deviations, scenario: &mut Scenario) -> anyhow::Result<bool> {
    let Some(record) = deviations.tracks.get(&scenario.id) else { return Ok(false) };
    let Some(certificate) = record.certificate_in(scenario.origin) else { return Ok(false) };
    let place = format!("{}: `{}`", deviations.file.name, scenario.id);
    if let Some(wanted) = &record.scenario_digest {
        let found = scenario.digest();
        if found != *wanted {
            bail!("{place}: made for a scenario with the digest {wanted}, not {found}");
        }
    }
    put(scenario, &record.track_in(scenario.origin), &certificate).context(place)?;
    Ok(true)
}

/// Lets the AV follow a track, and each agent its response; agents without a response keep their log. Appends
/// `certificate` to the id.
pub(super) fn put(
    scenario: &mut Scenario,
    av: &[AgentState],
    certificate: &Certificate,
) -> anyhow::Result<()> {
    let mut futures = scenario.log_future.tracks.clone();
    let steps = scenario.length().future;
    let mut replace = |slot: usize, states: &[AgentState]| -> anyhow::Result<()> {
        if states.len() != steps {
            bail!("a track has {} steps, expected {steps}", states.len());
        }
        futures[slot] = states.iter().map(|s| Some(*s)).collect::<Vec<Frame>>();
        Ok(())
    };
    replace(0, av)?;
    for response in &certificate.responses {
        let slot = scenario.start.agents.iter().position(|a| a.id == response.agent);
        let slot = slot.with_context(|| format!("no agent `{}`", response.agent))?;
        // A response begins with the state at the current frame.
        replace(slot, response.track.get(1..).unwrap_or_default())?;
    }
    replace_future(scenario, futures.iter().map(Vec::as_slice), NAME);
    Ok(())
}
