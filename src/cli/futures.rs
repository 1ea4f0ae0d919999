//! Scenarios whose future is a rollout: what agents would have done, in the place of what was logged.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::formats::rollouts::{self, Reader, RolloutRecord};
use crate::scene::{FUTURE, Scenario};

/// The rollouts of one simulator, read as far as they are asked for.
pub(super) struct Futures {
    path: PathBuf,
    model: String,
    /// The scenarios that have a rollout.
    there: BTreeSet<String>,
    reader: Reader,
    /// Read on the way to another one. Few, as files are in the order of the scenarios.
    waiting: BTreeMap<String, RolloutRecord>,
}

impl Futures {
    /// Opens a file of rollouts.
    pub(super) fn open(path: &Path, model: &str) -> anyhow::Result<Self> {
        let mut there = BTreeSet::new();
        for record in rollouts::read(path)? {
            let record = record?;
            if is_wanted(&record, model) {
                there.insert(record.scenario_id);
            }
        }
        if there.is_empty() {
            bail!("{}: no rollouts of `{model}`", path.display());
        }
        let (path, model, waiting) = (path.to_owned(), model.to_owned(), BTreeMap::new());
        Ok(Self { reader: rollouts::read(&path)?, path, model, there, waiting })
    }

    /// Gives a scenario the first rollout of it as its future, and a name that says so. False where there is none.
    pub(super) fn put_into(&mut self, scenario: &mut Scenario) -> anyhow::Result<bool> {
        let Some(record) = self.find(&scenario.id)? else { return Ok(false) };
        let tracks = record.tracks_in(scenario.origin);
        for (slot, agent) in scenario.start.agents.iter().enumerate() {
            let track = record.agent_ids.iter().position(|id| *id == agent.id).map(|i| &tracks[i]);
            let track = track.with_context(|| {
                let (file, scenario, agent) = (self.path.display(), &scenario.id, &agent.id);
                format!("{file}: the rollout of `{scenario}` lacks its agent `{agent}`")
            })?;
            if track.len() != FUTURE {
                bail!("{}: `{}`: {} steps, expected {FUTURE}", self.path.display(), scenario.id, track.len());
            }
            scenario.log_future.tracks[slot].clone_from(track);
        }
        scenario.deviation = None;
        scenario.unselected.clear();
        scenario.id = format!("{}+{}", scenario.id, self.model);
        Ok(true)
    }

    fn find(&mut self, id: &str) -> anyhow::Result<Option<RolloutRecord>> {
        if !self.there.contains(id) {
            return Ok(None);
        }
        if let Some(found) = self.waiting.remove(id) {
            return Ok(Some(found));
        }
        for record in self.reader.by_ref() {
            let record = record?;
            if !is_wanted(&record, &self.model) {
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

fn is_wanted(record: &RolloutRecord, model: &str) -> bool {
    record.simulator == model && record.rollout == 0
}
