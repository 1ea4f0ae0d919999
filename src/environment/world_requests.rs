//! Requests about an environment whose agents are moved.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use serde::Deserialize;
use serde_json::json;

use super::action::ActionKind;
use super::arrays::Sizes;
use super::requests::{end_document, existing, put_arrays, select, shapes, tracks_answer};
use super::scenarios::Reading;
use super::scores::metric_options;
use super::session::{Answer, RequestError, answer, arguments};
use super::world::{AGENT_MEASURES, World};
use crate::evaluation::{RunParts, RunSpec, Selection};
use crate::external::{Frame, Values};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewWorld {
    reading: Reading,
    /// Ids of scenarios; all by default.
    ids: BTreeSet<String>,
    /// Number of scenarios of every file.
    limit: Option<usize>,
    /// Policy of the AV.
    av: String,
    /// File of deviated AVs.
    deviations: Option<PathBuf>,
    action: ActionKind,
    sizes: Sizes,
    /// Whether finished episodes are scored.
    scores: bool,
    metric_options: BTreeMap<String, String>,
}

/// Creates the environment; answers with its scenarios and the shapes of its arrays.
pub(super) fn create(request: &Frame, world: &mut Option<World>) -> Answer {
    let given: NewWorld = arguments(request)?;
    let options = metric_options(&given.metric_options)?;
    let mut spec = RunSpec::default();
    spec.subject.av = Some(given.av.parse().map_err(RequestError::new)?);
    spec.subject.input.deviations = given.deviations;
    let selection = Selection { ids: given.ids, ..Selection::default() };
    let scenarios = select(&given.reading, &selection, given.limit)?;
    let options = given.scores.then_some(options);
    let new = World::new(scenarios, spec.plan(RunParts::default())?, given.action, given.sizes, options)?;
    let scenarios = new.scenarios();
    let ids: Vec<&str> = scenarios.iter().map(|scenario| scenario.id.as_str()).collect();
    let agents = scenarios.iter().map(|scenario| scenario.start.agents.len() - 1).max();
    let description = json!({
        "scenarios": ids,
        "agents": agents,
        "measures": AGENT_MEASURES,
        "arrays": shapes(new.sizes()),
    });
    *world = Some(new);
    answer("world", &description)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Beginning {
    scenario: usize,
    rollout: u32,
}

/// Begins an episode; answers with the ids of the agents after the AV and their observations.
pub(super) fn reset(request: &Frame, world: &mut Option<World>) -> Answer {
    let world = existing(world)?;
    let Beginning { scenario, rollout } = arguments(request)?;
    let agents = &world.reset(scenario, rollout)?.start.agents[1..];
    let ids: Vec<&str> = agents.iter().map(|agent| agent.id.as_str()).collect();
    let mut answer = answer("observation", &ids)?;
    put_arrays(&mut answer, world.sizes(), world.actions()[0], world.observe());
    Ok(answer)
}

/// Executes the actions, f64 [agents, values]; answers with observations and measures.
pub(super) fn step(request: &Frame, world: &mut Option<World>) -> Answer {
    let world = existing(world)?;
    let shape = world.actions();
    let actions = request.floats("actions", &shape)?;
    // Velocities of states may be unknown.
    let is_fit = |i: &usize| actions[*i].is_finite() || shape[1] == 5 && i % 5 >= 3 && actions[*i].is_nan();
    if let Some(i) = (0..actions.len()).find(|i| !is_fit(i)) {
        return Err(RequestError::new(format_args!(
            "value {} of the action of agent {} is {}, expected a finite number",
            i % shape[1],
            i / shape[1] + 1,
            actions[i]
        )));
    }
    let stepped = world.step(&actions)?;
    let end = stepped.is_over.then(|| end_document(world.scores())).transpose()?;
    let mut answer = answer("stepped", &end)?;
    put_arrays(&mut answer, world.sizes(), shape[0], world.observe());
    let measures = stepped.measures.iter().flatten().copied();
    answer.tensor("measures", Values::f64(&[shape[0], AGENT_MEASURES.len()], measures));
    Ok(answer)
}

/// Answers with the realised states so far.
pub(super) fn tracks(world: &mut Option<World>) -> Answer {
    let (scenario, tracks) = existing(world)?.tracks()?;
    tracks_answer(scenario, tracks)
}
