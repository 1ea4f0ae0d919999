//! Requests about an environment.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;
use serde_json::{Value, json};

use super::action::ActionKind;
use super::arrays::{Arrays, Sizes};
use super::drive::{
    End, EndCondition, Environment, EnvironmentSettings, EpisodeBeginning, MEASURES, Stepped,
};
use super::scenarios::Reading;
use super::scores::{Scored, metric_options};
use super::session::{Answer, RequestError, answer, arguments};
use crate::evaluation::{Adjustments, PlannedSimulator, Row, Selection, weights_file};
use crate::external::{Frame, FrameWriter, Values};
use crate::metrics::Event;
use crate::rollout::{Protocol, Replan, Settings};
use crate::scene::{FUTURE, Frame as StateFrame, Scenario};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewEnvironment {
    reading: Reading,
    /// Ids of scenarios; all by default.
    ids: BTreeSet<String>,
    /// Number of scenarios of every file.
    limit: Option<usize>,
    simulator: String,
    /// Files of weights, by id.
    weights: BTreeMap<String, String>,
    /// Parameters by id and dotted path, in TOML notation.
    parameters: BTreeMap<String, String>,
    replan: String,
    av_lookahead: bool,
    seed: u64,
    action: ActionKind,
    every: usize,
    sizes: Sizes,
    end_at: Vec<EndCondition>,
    /// Whether finished episodes are scored.
    scores: bool,
    metric_options: BTreeMap<String, String>,
}

/// Creates an environment; answers with its scenarios and the shapes of its arrays.
pub(super) fn create(request: &Frame, environment: &mut Option<Environment>) -> Answer {
    let given: NewEnvironment = arguments(request)?;
    let simulator = simulator(&given)?;
    let replan: Replan = given.replan.parse().map_err(RequestError::new)?;
    let options = metric_options(&given.metric_options)?;
    let settings = EnvironmentSettings {
        simulator: simulator.id,
        controller: simulator.controller,
        rollout: Settings {
            protocol: Protocol::Reactive,
            replan,
            av_lookahead: given.av_lookahead,
            seed: given.seed,
        },
        action: given.action,
        every: given.every,
        sizes: given.sizes,
        end_at: given.end_at,
        scores: given.scores.then_some(options),
    };
    let selection = Selection { ids: given.ids, ..Selection::default() };
    let scenarios = select(&given.reading, &selection, given.limit)?;
    let new = Environment::new(scenarios, settings)?;
    let ids: Vec<&str> = new.scenarios().iter().map(|scenario| scenario.id.as_str()).collect();
    let arrays = shapes(&given.sizes);
    let description = json!({
        "scenarios": ids,
        "measures": MEASURES,
        "arrays": arrays,
        "steps": FUTURE.div_ceil(given.every),
    });
    *environment = Some(new);
    answer("environment", &description)
}

/// Returns the names and shapes of arrays.
pub(super) fn shapes(sizes: &Sizes) -> Value {
    sizes.shapes().map(|(name, shape)| json!([name, shape])).to_vec().into()
}

fn simulator(given: &NewEnvironment) -> Result<PlannedSimulator, RequestError> {
    let mut adjustments = Adjustments::default();
    for (id, path) in &given.weights {
        adjustments.weights.push((id.clone(), weights_file(Path::new(path))?));
    }
    for (path, value) in &given.parameters {
        let Some((id, key)) = path.split_once('.') else {
            return Err(RequestError::new(format_args!(
                "the parameter `{path}` has no simulator: write ID.KEY, such as idm.vehicle.headway"
            )));
        };
        adjustments.parameters.push((id.to_owned(), key.to_owned(), value.clone()));
    }
    let ids = [given.simulator.clone()];
    <[_; 1]>::try_from(PlannedSimulator::adjusted(&ids, &adjustments)?).map(|[one]| one).map_err(|_| {
        RequestError::new(format_args!("`{}` names several simulators, expected one", given.simulator))
    })
}

/// Reads the selected scenarios.
pub(super) fn select(
    reading: &Reading,
    selection: &Selection,
    limit: Option<usize>,
) -> Result<Vec<Arc<Scenario>>, RequestError> {
    let mut scenarios = Vec::new();
    for source in reading.sources()? {
        for scenario in source.scenarios()?.take(limit.unwrap_or(usize::MAX)) {
            let scenario = scenario?;
            if selection.has_id(&scenario.id) {
                scenarios.push(Arc::new(scenario));
            }
        }
    }
    let found = |id: &&String| scenarios.iter().any(|scenario: &Arc<Scenario>| scenario.id == **id);
    match selection.ids.iter().find(|id| !found(id)) {
        Some(id) => Err(RequestError::new(format_args!("there is no scenario `{id}`"))),
        None => Ok(scenarios),
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Episodes {
    episodes: Vec<EpisodeBeginning>,
}

/// Begins an episode per slot; answers with the observations.
pub(super) fn reset(request: &Frame, environment: &mut Option<Environment>) -> Answer {
    let environment = existing(environment)?;
    let Episodes { episodes } = arguments(request)?;
    if episodes.is_empty() || episodes.iter().enumerate().any(|(i, episode)| episode.slot != i) {
        return Err(RequestError::new("`episodes` must have the slots 0, 1, …, at least one"));
    }
    environment.reset(&episodes)?;
    let mut answer = FrameWriter::new("observation");
    put_arrays(&mut answer, &environment.settings().sizes, environment.slots(), environment.observe());
    Ok(answer)
}

/// Executes the actions, f64 [slots, values], and begins the episodes of the arguments; answers with
/// observations, measures and ends.
pub(super) fn step(request: &Frame, environment: &mut Option<Environment>) -> Answer {
    let environment = existing(environment)?;
    let Episodes { episodes } = arguments(request)?;
    let shape = [environment.slots(), environment.settings().action.values()];
    let actions = request.floats("actions", &shape)?;
    let is_ignored = |slot: usize| episodes.iter().any(|episode| episode.slot == slot);
    let is_fit = |(i, value): (usize, &f64)| {
        // Velocities of states may be unknown.
        let may_be_unknown = environment.settings().action == ActionKind::State && i % shape[1] >= 3;
        value.is_finite() || may_be_unknown && value.is_nan() || is_ignored(i / shape[1])
    };
    if let Some(i) = (0..actions.len()).find(|&i| !is_fit((i, &actions[i]))) {
        return Err(RequestError::new(format_args!(
            "value {} of the action of slot {} is {}, expected a finite number",
            i % shape[1],
            i / shape[1],
            actions[i]
        )));
    }
    let stepped = environment.step(&actions, &episodes)?;
    let mut answer = answer("stepped", &ends(environment, &stepped)?)?;
    put_arrays(&mut answer, &environment.settings().sizes, environment.slots(), environment.observe());
    let measures = stepped.iter().flat_map(|one| one.measures);
    answer.tensor("measures", Values::f64(&[stepped.len(), MEASURES.len()], measures));
    let flag = |is_so: fn(&End) -> bool| {
        let flags = stepped.iter().map(move |one| u8::from(one.end.as_ref().is_some_and(is_so)));
        Values::u8(&[stepped.len()], flags.collect::<Vec<_>>())
    };
    answer.tensor("terminated", flag(|end| *end == End::Condition));
    answer.tensor("truncated", flag(|end| *end != End::Condition));
    Ok(answer)
}

/// Returns scores and failures of the episodes that ended, by slot.
fn ends(environment: &Environment, stepped: &[Stepped]) -> Result<Value, RequestError> {
    let mut ends = serde_json::Map::new();
    for (slot, one) in stepped.iter().enumerate() {
        let end = match &one.end {
            None => continue,
            Some(End::Failed(reason)) => json!({ "failure": reason }),
            Some(End::Condition | End::LastStep) => end_document(environment.scores(slot))?,
        };
        ends.insert(slot.to_string(), end);
    }
    Ok(Value::Object(ends))
}

/// Returns the document of the end of an episode; it is empty if episodes are not scored.
pub(super) fn end_document(scores: Option<(Vec<Row>, Vec<Vec<Event>>)>) -> Result<Value, RequestError> {
    let document = scores.map(|(rows, events)| serde_json::to_value(Scored::new(&rows, &events)));
    document.unwrap_or_else(|| Ok(json!({}))).map_err(RequestError::new)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SlotArguments {
    slot: usize,
}

/// Answers with the realised states of a slot so far.
pub(super) fn tracks(request: &Frame, environment: &mut Option<Environment>) -> Answer {
    let SlotArguments { slot } = arguments(request)?;
    let (scenario, tracks) = existing(environment)?.tracks(slot)?;
    tracks_answer(scenario, tracks)
}

/// Returns an answer with the tracks of a scenario, f64 [agents, frames, 5], NaN where absent or unknown.
pub(super) fn tracks_answer(scenario: &Scenario, tracks: &[Vec<StateFrame>]) -> Answer {
    let shape = [tracks.len(), tracks.first().map_or(0, Vec::len), 5];
    let values = tracks.iter().flatten().flat_map(|frame| {
        frame.map_or([f64::NAN; 5], |state| [state.x, state.y, state.heading, state.vx, state.vy])
    });
    let ids: Vec<&str> = scenario.start.agents.iter().map(|agent| agent.id.as_str()).collect();
    let mut answer = answer("tracks", &json!({ "scenario": scenario.id, "agents": ids }))?;
    answer.tensor("states", Values::f64(&shape, values));
    Ok(answer)
}

/// Returns the environment of an earlier request.
pub(super) fn existing<T>(environment: &mut Option<T>) -> Result<&mut T, RequestError> {
    environment.as_mut().ok_or_else(|| RequestError::new("there is no environment: create one first"))
}

/// Adds arrays of observations with this number of rows.
pub(super) fn put_arrays(answer: &mut FrameWriter, sizes: &Sizes, rows: usize, arrays: Arrays) {
    for ((name, shape), values) in sizes.shapes().into_iter().zip(arrays.0) {
        let shape: Vec<usize> = std::iter::once(rows).chain(shape).collect();
        answer.tensor(name, Values::f32(&shape, values));
    }
}
