//! Scenarios whose logged future is replaced by a rollout.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::evaluation::ROLLOUTS;
use crate::formats::rollouts::{self, Reader, RolloutRecord};
use crate::scene::{Frame, Scenario, limits};

/// Rollouts of one simulator, read on demand.
pub(super) struct Futures {
    path: PathBuf,
    model: String,
    /// Ids of the scenarios that have a rollout.
    available: BTreeSet<String>,
    reader: Reader,
    /// Records read while searching for another one. Few, as files are in the order of the scenarios.
    waiting: BTreeMap<String, RolloutRecord>,
}

impl Futures {
    /// Opens a file of rollouts.
    pub(super) fn open(path: &Path, model: &str) -> anyhow::Result<Self> {
        if path.is_dir() {
            let file = path.join(ROLLOUTS);
            bail!("{} is a folder: give the file of its rollouts, {}", path.display(), file.display());
        }
        let mut available = BTreeSet::new();
        for record in rollouts::read(path)? {
            let record = record?;
            if is_first_rollout(&record, model) {
                available.insert(record.scenario_id);
            }
        }
        if available.is_empty() {
            bail!("{}: no rollouts of `{model}`", path.display());
        }
        let (path, model, waiting) = (path.to_owned(), model.to_owned(), BTreeMap::new());
        Ok(Self { reader: rollouts::read(&path)?, path, model, available, waiting })
    }

    /// Replaces the future of a scenario by its first rollout and appends the simulator to its id.
    /// Returns `false` if there is no rollout.
    pub(super) fn put_into(&mut self, scenario: &mut Scenario) -> anyhow::Result<bool> {
        let Some(record) = self.find(&scenario.id)? else { return Ok(false) };
        let tracks = record.tracks_in(scenario.origin);
        let mut futures = Vec::new();
        for agent in &scenario.start.agents {
            let track = record.agent_ids.iter().position(|id| *id == agent.id).map(|i| &tracks[i]);
            let track = track.with_context(|| {
                let (file, scenario, agent) = (self.path.display(), &scenario.id, &agent.id);
                format!("{file}: the rollout of `{scenario}` lacks its agent `{agent}`")
            })?;
            let steps = scenario.length().future;
            if track.len() != steps {
                bail!("{}: `{}`: {} steps, expected {steps}", self.path.display(), scenario.id, track.len());
            }
            let center = scenario.start.now(0).position();
            if let Some((_, name, value, expected)) = limits::first_beyond(track, center) {
                let (file, scenario, agent) = (self.path.display(), &scenario.id, &agent.id);
                bail!("{file}: `{scenario}`: agent `{agent}`: `{name}` is {value:e}, expected {expected}");
            }
            futures.push(track.as_slice());
        }
        replace_future(scenario, futures, &self.model);
        Ok(true)
    }

    fn find(&mut self, id: &str) -> anyhow::Result<Option<RolloutRecord>> {
        if !self.available.contains(id) {
            return Ok(None);
        }
        if let Some(found) = self.waiting.remove(id) {
            return Ok(Some(found));
        }
        for record in self.reader.by_ref() {
            let record = record?;
            if !is_first_rollout(&record, &self.model) {
                continue;
            }
            if record.scenario_id == id {
                return Ok(Some(record));
            }
            self.waiting.insert(record.scenario_id.clone(), record);
        }
        Ok(None)
    }
}

/// Replaces the future of a scenario by the tracks of a rollout, one per agent, and appends the simulator to
/// its id.
pub(super) fn replace_future<'a>(
    scenario: &mut Scenario,
    futures: impl IntoIterator<Item = &'a [Frame]>,
    model: &str,
) {
    for (track, future) in scenario.log_future.tracks.iter_mut().zip(futures) {
        *track = future.to_vec();
    }
    // Recorded heights belong to recorded positions.
    scenario.log_future.heights.iter_mut().for_each(|heights| heights.fill(None));
    scenario.deviation = None;
    // Obstacles are among the agents that are not selected.
    scenario.unselected.clear();
    scenario.start.obstacles.clear();
    scenario.start.obstacle_heights.clear();
    scenario.id = format!("{}+{model}", scenario.id);
}

fn is_first_rollout(record: &RolloutRecord, model: &str) -> bool {
    record.simulator == model && record.rollout == 0
}
