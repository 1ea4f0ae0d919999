//! Rollouts of simulators that are run on request.

use std::sync::Arc;

use anyhow::anyhow;

use crate::evaluation::PlannedSimulator;
use crate::report::birdseye::{Mark, marks_of};
use crate::rollout::{DeviatedAv, Request, Settings, roll_out};
use crate::scene::{Frame, Scenario};

/// Runs rollout `index` of a simulator against the deviated AV of a scenario, with the default
/// settings of `run` and the same result. Returns the tracks and the events to mark.
pub(super) fn rollout(
    simulator: &PlannedSimulator,
    index: u32,
    scenario: &Scenario,
) -> anyhow::Result<(Vec<Vec<Frame>>, Vec<Mark>)> {
    let deviation = scenario.deviation.as_ref().ok_or_else(|| {
        anyhow!(
            "scenario `{}` has no deviated AV for the simulators to react to; run them with --av or \
             --deviations and --keep-rollouts, and give the run folder with --rollout",
            scenario.id
        )
    })?;
    let av = DeviatedAv::new(scenario, deviation.track.clone())?;
    let request = Request { scenario, av: Some(Arc::new(av)), rollout: index };
    let mut results = roll_out(vec![request], &simulator.controller, &Settings::default());
    let done =
        results.pop().ok_or_else(|| anyhow!("scenario `{}`: no rollout was produced", scenario.id))??;
    let marks = marks_of(scenario, &done.tracks);
    Ok((done.tracks, marks))
}
