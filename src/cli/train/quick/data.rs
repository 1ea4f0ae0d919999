//! Training data of the quick path: logs, and scenarios in which agents react to an AV that leaves its log.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::Context;

use crate::cli::train::data::write_absent;
use crate::cli::train::deviated::{deviated, with_rollout};
use crate::generation::{GenerationSettings, Generator, Preset};
use crate::models;
use crate::rollout::Controller;
use crate::scene::Scenario;

/// Seed of the data, which are the same in every quick training.
const SEED: u64 = 1;
/// Number of generated logs.
const LOGS: usize = 800;
/// Number of further logs, of which those become scenarios with reactions whose AV can deviate.
const DEVIATED_LOGS: usize = 900;
/// Simulator that reacts.
const REACTING: &str = "idm";

/// Files of training data.
pub(super) struct Files {
    /// Logs.
    pub(super) logs: PathBuf,
    /// Scenarios with reactions.
    pub(super) reactions: PathBuf,
}

/// Writes the files that a folder does not have yet. `None` if it was stopped.
pub(super) fn make(folder: &Path, jobs: usize, stop: &AtomicBool) -> anyhow::Result<Option<Files>> {
    let files = Files { logs: folder.join("logs.parquet"), reactions: folder.join("reactions.parquet") };
    let preset = Preset::Train;
    let generator =
        Generator::new(GenerationSettings { preset, seed: SEED, ..GenerationSettings::default() })?;
    let idm = models::find(REACTING).context("there is no reacting simulator")?.simulator()?;
    // Numbers of scenarios are apart, so that no scenario is in both files.
    let log = |number| Ok([generator.scenario(number).into_iter().collect()]);
    let reaction = |number: u64| -> anyhow::Result<[Vec<Scenario>; 1]> {
        let log = generator.scenario(LOGS as u64 + number).ok();
        let made = log.map(|log| with_reactions(log, &idm)).transpose()?;
        Ok([made.flatten().into_iter().collect()])
    };
    let done = write_absent([&files.logs], LOGS, jobs, stop, log)?
        && write_absent([&files.reactions], DEVIATED_LOGS, jobs, stop, reaction)?;
    Ok(done.then_some(files))
}

/// Returns the scenario with an AV that deviates and agents that react to it; `None` if nothing was found
/// that its AV could do.
fn with_reactions(scenario: Scenario, simulator: &Controller) -> anyhow::Result<Option<Scenario>> {
    let Some(chosen) = deviated(&scenario, SEED) else { return Ok(None) };
    with_rollout(scenario, &chosen, REACTING, simulator).map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agents_react_to_an_av_that_leaves_its_log() {
        let settings =
            GenerationSettings { preset: Preset::Train, seed: SEED, ..GenerationSettings::default() };
        let generator = Generator::new(settings).unwrap();
        let idm = models::find(REACTING).unwrap().simulator().unwrap();
        let made = (0..40).find_map(|number| {
            let log = generator.scenario(number).unwrap();
            Some((with_reactions(log.clone(), &idm).unwrap()?, log))
        });
        let (reacting, log) = made.expect("none of 40 AVs can deviate");
        assert_eq!(reacting.id, format!("{}+idm", log.id));
        assert!(reacting.deviation.is_none());
        assert_eq!(reacting.start.history, log.start.history);
        assert_ne!(reacting.log_future.tracks[0], log.log_future.tracks[0], "the AV");
        assert_ne!(reacting.log_future.tracks[1..], log.log_future.tracks[1..], "the others");
    }
}
