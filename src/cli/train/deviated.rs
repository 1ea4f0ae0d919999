//! Scenarios whose AV leaves its log, as training data.

use std::sync::Arc;

use anyhow::anyhow;

use crate::cli::certified;
use crate::cli::futures::replace_future;
use crate::curation::{
    CandidateRecord, Chooser, CurationOutcome, CurationSettings, SOURCES, curate_scenario,
};
use crate::rollout::{Controller, DeviatedAv, Request, Settings, roll_out};
use crate::scene::{DeviatedTrack, Scenario};

/// Returns the deviated AV that curation chooses; `None` if nothing was found that the AV could do.
pub(super) fn deviated(scenario: &Scenario, seed: u64) -> Option<DeviatedTrack> {
    several(scenario, seed, 1).pop()
}

/// Returns up to `most` deviated AVs: the one that curation chooses, then what it would choose next to it.
/// Fewer if nothing else was found that the AV could do.
pub(super) fn several(scenario: &Scenario, seed: u64, most: usize) -> Vec<DeviatedTrack> {
    let settings = CurationSettings { seed, scenes: false, ..CurationSettings::default() };
    let CurationOutcome::Retained(mut record, _) = curate_scenario(scenario, SOURCES[0], &settings) else {
        return Vec::new();
    };
    let mut chooser = Chooser::default();
    let track = |chosen: &CandidateRecord| DeviatedTrack {
        category: Some(chosen.taxonomy.category),
        track: chosen.candidate.track[1..].to_vec(),
        certificate: chosen.certificate.clone(),
    };
    let next = || chooser.choose_among(&mut record, |candidate| !candidate.chosen).map(track);
    std::iter::from_fn(next).take(most).collect()
}

/// Returns the scenario with this AV and with agents that react to it as a simulator does.
pub(super) fn with_rollout(
    mut scenario: Scenario,
    deviated: &DeviatedTrack,
    name: &str,
    simulator: &Controller,
) -> anyhow::Result<Scenario> {
    let av = Arc::new(DeviatedAv::new(&scenario, deviated.track.clone())?);
    let request = Request { scenario: &scenario, av: Some(av), rollout: 0 };
    let rollout = roll_out(vec![request], simulator, &Settings::default()).pop();
    let rollout = rollout.ok_or_else(|| anyhow!("a rollout is missing"))??;
    let history = scenario.length().history;
    let futures = rollout.tracks.iter().map(|track| &track[history..]);
    replace_future(&mut scenario, futures, name);
    Ok(scenario)
}

/// Returns the scenario with this AV and the responses of its certificate; `None` without a certificate.
pub(super) fn with_certificate(
    mut scenario: Scenario,
    deviated: &DeviatedTrack,
) -> anyhow::Result<Option<Scenario>> {
    let Some(certificate) = &deviated.certificate else { return Ok(None) };
    certified::put(&mut scenario, &deviated.track, certificate)?;
    Ok(Some(scenario))
}
