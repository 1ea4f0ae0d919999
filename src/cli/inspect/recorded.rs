//! Rollouts and events of one scenario, from a run folder.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use anyhow::{Context, bail};
use serde_json::Value;

use crate::evaluation::{EVENTS, ROLLOUTS, entered_in, read_provenance, recorded_tracks};
use crate::formats;
use crate::report::birdseye::{Mark, MarkKind};
use crate::scene::{Frame, Scenario};

/// Returns the scenario with the agents that entered rollouts of a run; `None` if none could.
pub(super) fn with_entered(
    run: &Path,
    simulators: &[String],
    index: u32,
    scenario: &Scenario,
) -> anyhow::Result<Option<Scenario>> {
    let path = run.join(ROLLOUTS);
    if !path.exists() || read_provenance(run)?.settings.entering.is_none() {
        return Ok(None);
    }
    let mut entered = BTreeSet::new();
    for record in formats::rollouts::read(&path)? {
        let record = record?;
        let is_drawn = simulators.contains(&record.simulator) && record.rollout == index;
        if record.scenario_id == scenario.id && is_drawn {
            entered.extend(entered_in(scenario, &record));
        }
    }
    Ok(Some(scenario.with_entered(&entered.into_iter().collect::<Vec<_>>())))
}

/// Reads the realised tracks of a rollout in a run folder.
pub(super) fn rollout(
    run: &Path,
    simulator: &str,
    index: u32,
    scenario: &Scenario,
) -> anyhow::Result<Vec<Vec<Frame>>> {
    let path = run.join(ROLLOUTS);
    if !path.exists() {
        bail!("{} has no {ROLLOUTS}: run with --keep-rollouts", run.display());
    }
    for record in formats::rollouts::read(&path)? {
        let record = record?;
        if record.scenario_id == scenario.id && record.simulator == simulator && record.rollout == index {
            return Ok(recorded_tracks(scenario, &record)?);
        }
    }
    bail!("{} holds no rollout {index} of `{simulator}` in `{}`", path.display(), scenario.id)
}

/// Reads the events of a rollout that pictures mark.
pub(super) fn marks(run: &Path, simulator: &str, rollout: u32, scenario: &str) -> anyhow::Result<Vec<Mark>> {
    let path = run.join(EVENTS);
    let name = || format!("could not read {}", path.display());
    let mut marks = Vec::new();
    for line in BufReader::new(File::open(&path).with_context(name)?).lines() {
        let event: Value = serde_json::from_str(&line.with_context(name)?).with_context(name)?;
        let text = |key: &str| event[key].as_str().unwrap_or_default();
        if text("scenario") != scenario
            || text("simulator") != simulator
            || event["rollout"].as_u64() != Some(u64::from(rollout))
        {
            continue;
        }
        let Some(kind) = MarkKind::of_event(text("metric"), event["counted"] == true) else { continue };
        let step = event["step"].as_u64().and_then(|s| usize::try_from(s).ok()).unwrap_or(0);
        marks.push(Mark { agent: text("agent").to_owned(), step, kind });
    }
    Ok(marks)
}
