//! The rollouts of a run: stored in parts during the run, joined in canonical order at its end.

use std::path::Path;

use reactsim_formats::rollouts::{RolloutRecord, Writer, read};
use reactsim_rollout::Rollout;
use reactsim_scene::{Agent, AgentKind, AgentState, Frame, LoggedAgent, Scenario, limits};

use crate::error::EvaluationError;
use crate::folder::RunFolder;
use crate::layout::ROLLOUTS;
use crate::row::RecordPosition;
use crate::statistics::tally::Tally;

/// Writes all rollouts of one scenario and one simulator to a file.
pub(crate) fn write_part(
    path: &Path,
    scenario: &Scenario,
    simulator: &str,
    rollouts: &[Rollout],
) -> Result<(), EvaluationError> {
    let mut writer = Writer::create(path)?;
    let history = scenario.length().history;
    for (index, rollout) in (0..).zip(rollouts) {
        writer.write(&RolloutRecord {
            scenario_id: scenario.id.clone(),
            simulator: simulator.to_owned(),
            rollout: index,
            origin: Some(scenario.origin),
            agent_ids: agents(scenario, rollout).map(|a| a.id.clone()).collect(),
            tracks: rollout.tracks.iter().map(|t| t[history..].to_vec()).collect(),
        })?;
    }
    Ok(writer.finish()?)
}

/// Returns the agents of a rollout, in the order of its tracks.
fn agents<'s>(scenario: &'s Scenario, rollout: &'s Rollout) -> impl Iterator<Item = &'s Agent> {
    let entered = rollout.entered.iter().map(|entered| &scenario.unselected[entered.logged].agent);
    scenario.start.agents.iter().chain(entered)
}

/// Returns the indices in [`Scenario::unselected`] of the agents of a recorded rollout that entered it:
/// agents of the record that are absent at the current frame.
pub fn entered_in(scenario: &Scenario, record: &RolloutRecord) -> Vec<usize> {
    let current = scenario.start.current();
    let is_later =
        |logged: &LoggedAgent| logged.track[current].is_none() && logged.agent.kind != AgentKind::Other;
    let logged = |id: &String| scenario.unselected.iter().position(|a| a.agent.id == *id && is_later(a));
    record.agent_ids.iter().filter_map(logged).collect()
}

/// Returns whether a file of rollouts is there. A truncated one is removed, so that it is made again.
pub(crate) fn are_there(path: &Path) -> bool {
    let is_whole = read(path).is_ok();
    if !is_whole {
        // Fails if there is none.
        std::fs::remove_file(path).ok();
    }
    is_whole
}

/// Joins the parts of all scenarios of the tally. Without parts, the file of an earlier finished run is left
/// as it is.
pub(crate) fn join_parts(folder: &RunFolder, tally: &Tally) -> Result<(), EvaluationError> {
    let target = folder.path().join(ROLLOUTS);
    let pairs: Vec<(RecordPosition, usize)> = tally
        .entries
        .iter()
        .flat_map(|(place, entry)| (0..entry.cells.len()).map(move |s| (*place, s)))
        .filter(|(place, simulator)| tally.has(*place, *simulator))
        .collect();
    let mut parts = Vec::with_capacity(pairs.len());
    for (place, simulator) in pairs {
        parts.push(folder.part(place, simulator)?);
    }
    if target.exists() && parts.iter().all(|p| !p.exists()) {
        return Ok(());
    }
    let mut writer = Writer::create(&target)?;
    for part in parts {
        let damaged =
            |error| EvaluationError::Resumable(format!("{error}; delete the file, and continue the run"));
        for record in read(&part).map_err(damaged)? {
            writer.write(&record.map_err(damaged)?)?;
        }
    }
    Ok(writer.finish()?)
}

/// Returns the tracks of a recorded rollout: per agent of the scenario its history, then the recorded steps.
/// Agents that were not recorded are absent; recorded agents beyond the scenario's selected ones are left
/// out.
///
/// # Errors
/// [`EvaluationError`] names an agent that is unknown or repeated, a number of steps other than that of the
/// scenario, a state beyond the limits of scenarios, or a missing AV.
pub fn recorded_tracks(
    scenario: &Scenario,
    record: &RolloutRecord,
) -> Result<Vec<Vec<Frame>>, EvaluationError> {
    let refuse = |text: String| Err(EvaluationError::Refused(text));
    let (agents, expected) = (&scenario.start.agents, scenario.length().future);
    let mut tracks: Vec<Option<Vec<Frame>>> = vec![None; agents.len()];
    for (id, steps) in record.agent_ids.iter().zip(record.tracks_in(scenario.origin)) {
        if steps.len() != expected {
            let found = steps.len();
            return refuse(format!(
                "agent `{id}` has {found} steps, expected the {expected} of the scenario"
            ));
        }
        if let Some((k, name, value, expected)) =
            limits::first_beyond(&steps, scenario.start.now(0).position())
        {
            // Large numbers with all their digits are no help.
            let at = format!("`{name}` at step {} is {value:e}", k + 1);
            return refuse(format!("agent `{id}`: {at}, expected {expected}"));
        }
        match agents.iter().position(|a| a.id == *id) {
            Some(i) if tracks[i].is_some() => return refuse(format!("agent `{id}` occurs twice")),
            Some(i) => tracks[i] = Some(scenario.start.history[i].iter().copied().chain(steps).collect()),
            None if scenario.unselected.iter().any(|a| a.agent.id == *id) => {}
            None => return refuse(format!("agent `{id}` is not in the scenario")),
        }
    }
    if tracks.first().is_none_or(Option::is_none) {
        return refuse(format!("the AV `{}` is missing", agents[0].id));
    }
    let absent = |history: &Vec<Frame>| -> Vec<Frame> {
        history.iter().copied().chain(std::iter::repeat_n(None::<AgentState>, expected)).collect()
    };
    let filled = tracks.into_iter().zip(&scenario.start.history);
    Ok(filled.map(|(track, history)| track.unwrap_or_else(|| absent(history))).collect())
}

#[cfg(test)]
mod tests {
    use reactsim_scene::{Agent, AgentKind, Length, LoggedAgent, ScenarioParts};

    use super::*;

    #[test]
    fn rollouts_have_the_steps_of_their_scenario() {
        for (history, future) in [(11, 80), (11, 150), (2, 60)] {
            let length = Length { history, future };
            let state =
                |f: usize| Some(AgentState { x: f as f64 * 0.1, y: 0.0, heading: 0.0, vx: 1.0, vy: 0.0 });
            let agent = |id: &str| LoggedAgent {
                agent: Agent { id: id.to_owned(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 },
                track: (0..length.frames()).map(state).collect(),
                heights: Vec::new(),
            };
            let agents = vec![agent("av"), agent("a")];
            let parts = ScenarioParts { id: "s".to_owned(), length, agents, ..ScenarioParts::default() };
            let scenario = Scenario::assemble(parts).unwrap();
            let record = |steps: usize| RolloutRecord {
                scenario_id: "s".to_owned(),
                simulator: "idm".to_owned(),
                rollout: 0,
                origin: None,
                agent_ids: vec!["av".to_owned()],
                tracks: vec![vec![Some(scenario.start.now(0)); steps]],
            };
            let tracks = recorded_tracks(&scenario, &record(future)).unwrap();
            // Agents that were not recorded are absent.
            assert!(tracks.iter().all(|track| track.len() == length.frames()));
            assert!(tracks[1][history..].iter().all(Option::is_none));
            let error = recorded_tracks(&scenario, &record(future + 1)).unwrap_err().to_string();
            let expected =
                format!("agent `av` has {} steps, expected the {future} of the scenario", future + 1);
            assert_eq!(error, expected);
        }
    }
}
