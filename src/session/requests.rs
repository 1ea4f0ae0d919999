//! Requests about environments.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use serde::Deserialize;
use serde_json::{Value, json};

use super::action::ActionKind;
use super::arrays::{Arrays, Sizes};
use super::environment::{
    End, EndCondition, Environment, EnvironmentSettings, EpisodeBeginning, MEASURES, Stepped,
};
use super::scenarios::{Reading, Selected};
use super::scores::{Scored, metric_options};
use super::traffic::NamedTraffic;
use super::wire::{Answer, RequestError, answer, arguments, refused};
use super::world::{AGENT_MEASURES, World, WorldSettings};
use crate::evaluation::{Row, RunParts, RunSpec};
use crate::external::{Frame, FrameWriter, Parent, Values};
use crate::metrics::{Event, Options};
use crate::report::animation::{Animation, Panel};
use crate::report::birdseye::marks_of;
use crate::scene::{Frame as StateFrame, Scenario};

/// What all environments have.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Common {
    reading: Reading,
    /// Ids of scenarios; all by default.
    ids: BTreeSet<String>,
    /// Largest number of scenarios.
    limit: Option<usize>,
    /// The simulator; none if actions move all agents.
    traffic: Option<NamedTraffic>,
    action: ActionKind,
    sizes: Sizes,
    /// Whether finished episodes are scored.
    scores: bool,
    metric_options: BTreeMap<String, String>,
}

impl Common {
    fn scenarios(&self) -> Result<Selected, RequestError> {
        self.reading.select(&self.ids, self.limit)
    }

    /// Returns the variants of the metrics, if episodes are scored.
    fn options(&self) -> Result<Option<Options>, RequestError> {
        let options = metric_options(&self.metric_options)?;
        Ok(self.scores.then_some(options))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewEnvironment {
    common: Common,
    every: usize,
    end_at: Vec<EndCondition>,
}

/// Creates an environment; answers with its scenarios and the shapes of its arrays.
pub(super) fn create(request: &Frame, environment: &mut Option<Environment>, parent: &Parent) -> Answer {
    let NewEnvironment { common, every, end_at } = arguments(request)?;
    let Some(traffic) = &common.traffic else { return refused("`traffic` is missing") };
    let (action, sizes, scores) = (common.action, common.sizes, common.options()?);
    let Selected { scenarios, skipped } = common.scenarios()?;
    let settings =
        EnvironmentSettings { traffic: traffic.start(parent)?, action, every, sizes, end_at, scores };
    let new = environment.insert(Environment::new(scenarios, settings)?);
    let description = json!({
        "scenarios": ids(new.scenarios()),
        "skipped": skipped.map(|skipped| skipped.to_string()),
        "measures": MEASURES,
        "arrays": shapes(&sizes),
    });
    answer("environment", &description)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Episodes {
    episodes: Vec<EpisodeBeginning>,
}

/// Begins an episode per slot; answers with the observations.
pub(super) fn reset(request: &Frame, environment: &mut Environment) -> Answer {
    let Episodes { episodes } = arguments(request)?;
    if episodes.is_empty() || episodes.iter().enumerate().any(|(i, episode)| episode.slot != i) {
        return refused("`episodes` must have the slots 0, 1, …, at least one");
    }
    environment.reset(&episodes)?;
    let mut answer = FrameWriter::new("observation");
    let slots = 0..environment.slots();
    put_observations(&mut answer, environment, slots);
    Ok(answer)
}

/// Begins episodes in place of those in their slots; answers with their observations, in the same order.
pub(super) fn begin(request: &Frame, environment: &mut Environment) -> Answer {
    let Episodes { episodes } = arguments(request)?;
    environment.begin(&episodes)?;
    let mut answer = FrameWriter::new("observation");
    put_observations(&mut answer, environment, episodes.iter().map(|episode| episode.slot));
    Ok(answer)
}

/// Executes the actions, f64 [slots, values], and begins the episodes of the arguments; answers with
/// observations, measures and ends.
pub(super) fn step(request: &Frame, environment: &mut Environment) -> Answer {
    let Episodes { episodes } = arguments(request)?;
    let actions =
        request.floats("actions", &[environment.slots(), environment.settings().action.values()])?;
    let stepped = environment.step(&actions, &episodes)?;
    let mut answer = answer("stepped", &ends(environment, &stepped)?)?;
    let slots = 0..environment.slots();
    put_observations(&mut answer, environment, slots);
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SlotArguments {
    slot: usize,
}

/// Answers with the realised states of a slot so far.
pub(super) fn tracks(request: &Frame, environment: &Environment) -> Answer {
    let SlotArguments { slot } = arguments(request)?;
    let (scenario, tracks) = environment.tracks(slot)?;
    tracks_answer(scenario, tracks)
}

/// Answers with a picture of a slot.
pub(super) fn draw(request: &Frame, environment: &Environment) -> Answer {
    let drawing: Drawing = arguments(request)?;
    let (scenario, tracks) = environment.tracks(drawing.slot)?;
    drawing.answer(scenario, tracks)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewWorld {
    common: Common,
    /// Policy of the AV.
    av: String,
    /// File of deviated AVs.
    deviations: Option<PathBuf>,
    /// Number of agents that actions move; all by default.
    controlled: Option<usize>,
}

/// Creates an environment whose agents are moved; answers with its scenarios and the shapes of its arrays.
pub(super) fn create_world(request: &Frame, world: &mut Option<World>, parent: &Parent) -> Answer {
    let NewWorld { common, av, deviations, controlled } = arguments(request)?;
    let mut spec = RunSpec::default();
    spec.subject.av = Some(av.parse().map_err(RequestError::new)?);
    spec.subject.input.deviations = deviations;
    let plan = spec.plan(RunParts::default())?;
    let (action, sizes, scores) = (common.action, common.sizes, common.options()?);
    let Selected { scenarios, skipped } = common.scenarios()?;
    let traffic = common.traffic.as_ref().map(|traffic| traffic.start(parent)).transpose()?;
    let controlled = controlled.filter(|_| traffic.is_some()).unwrap_or(usize::MAX);
    let settings = WorldSettings { plan, traffic, controlled, action, sizes, scores };
    let new = world.insert(World::new(scenarios, settings)?);
    let others = |scenario: &Arc<Scenario>| scenario.start.agents.len() - 1;
    let description = json!({
        "scenarios": ids(new.scenarios()),
        "skipped": skipped.map(|skipped| skipped.to_string()),
        "agents": new.scenarios().iter().map(others).max().unwrap_or(0).min(controlled),
        "measures": AGENT_MEASURES,
        "arrays": shapes(&sizes),
    });
    answer("world", &description)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Beginning {
    scenario: usize,
    rollout: u32,
}

/// Begins an episode; answers with the ids of the agents that actions move, and their observations.
pub(super) fn reset_world(request: &Frame, world: &mut World) -> Answer {
    let Beginning { scenario, rollout } = arguments(request)?;
    let scenario = world.reset(scenario, rollout)?;
    let [agents, _] = world.actions();
    let ids: Vec<&str> = scenario.start.agents[1..=agents].iter().map(|agent| agent.id.as_str()).collect();
    let mut answer = answer("observation", &ids)?;
    let arrays = world.observe();
    put_arrays(&mut answer, world.sizes(), agents, arrays);
    Ok(answer)
}

/// Executes the actions, f64 [agents, values]; answers with observations and measures.
pub(super) fn step_world(request: &Frame, world: &mut World) -> Answer {
    let shape = world.actions();
    let stepped = world.step(&request.floats("actions", &shape)?)?;
    let end = stepped.is_over.then(|| end_document(world.scores())).transpose()?;
    let mut answer = answer("stepped", &end)?;
    let arrays = world.observe();
    put_arrays(&mut answer, world.sizes(), shape[0], arrays);
    let measures = stepped.measures.iter().flatten().copied();
    answer.tensor("measures", Values::f64(&[shape[0], AGENT_MEASURES.len()], measures));
    Ok(answer)
}

/// Answers with the realised states so far.
pub(super) fn world_tracks(world: &World) -> Answer {
    let (scenario, tracks) = world.tracks()?;
    tracks_answer(scenario, tracks)
}

/// Answers with a picture.
pub(super) fn draw_world(request: &Frame, world: &World) -> Answer {
    let drawing: Drawing = arguments(request)?;
    let (scenario, tracks) = world.tracks()?;
    drawing.answer(scenario, tracks)
}

/// A picture of an episode.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Drawing {
    /// The slot; 0 in an environment whose agents are moved.
    slot: usize,
    /// Side of the picture, pixels.
    size: u32,
    /// Half of the side of the picture, metres.
    radius: Option<f64>,
    /// Whether the AV stays in the middle.
    follow: bool,
    /// Stride between the steps of an animation; without it, a picture of the present step.
    every: Option<usize>,
}

impl Drawing {
    /// Returns the present step as u8 [height, width, 3], or an animation of the steps so far as a GIF.
    fn answer(&self, scenario: &Scenario, tracks: &[Vec<StateFrame>]) -> Answer {
        let length = scenario.length();
        let until = tracks.first().map_or(0, Vec::len).saturating_sub(length.history);
        let mut tracks = tracks.to_vec();
        tracks.iter_mut().for_each(|track| track.resize(length.frames(), None));
        let marks = marks_of(scenario, &tracks);
        let panel = Panel { title: scenario.id.clone(), rollout: Some(&tracks), marks };
        let animation = Animation {
            radius: self.radius,
            size: self.size,
            every: self.every.unwrap_or(1),
            until,
            follow: self.follow,
            ..Animation::new(scenario, vec![panel])
        };
        let mut answer = FrameWriter::new("picture");
        if self.every.is_some() {
            answer.tensor("gif", Values::bytes(animation.encode().map_err(RequestError::new)?));
        } else {
            let picture = animation.picture(until).map_err(RequestError::new)?;
            answer.tensor("rgb", Values::u8(&[picture.height, picture.width, 3], picture.rgb));
        }
        Ok(answer)
    }
}

/// Returns the environment of an earlier request.
pub(super) fn existing<T>(environment: &mut Option<T>) -> Result<&mut T, RequestError> {
    environment.as_mut().ok_or_else(|| RequestError::new("there is no environment: create one first"))
}

fn ids(scenarios: &[Arc<Scenario>]) -> Vec<&str> {
    scenarios.iter().map(|scenario| scenario.id.as_str()).collect()
}

/// Returns the names and shapes of arrays.
fn shapes(sizes: &Sizes) -> Value {
    sizes.shapes().map(|(name, shape)| json!([name, shape])).to_vec().into()
}

/// Adds the observations of slots.
fn put_observations(
    answer: &mut FrameWriter,
    environment: &mut Environment,
    slots: impl ExactSizeIterator<Item = usize>,
) {
    let (rows, arrays) = (slots.len(), environment.observe(slots));
    put_arrays(answer, &environment.settings().sizes, rows, arrays);
}

/// Adds arrays of observations with this number of rows.
fn put_arrays(answer: &mut FrameWriter, sizes: &Sizes, rows: usize, arrays: Arrays) {
    for ((name, shape), values) in sizes.shapes().into_iter().zip(arrays.0) {
        let shape: Vec<usize> = std::iter::once(rows).chain(shape).collect();
        answer.tensor(name, Values::f32(&shape, values));
    }
}

/// Returns the document of the end of an episode; it is empty if episodes are not scored.
fn end_document(scores: Option<(Vec<Row>, Vec<Vec<Event>>)>) -> Result<Value, RequestError> {
    let document = scores.map(|(rows, events)| serde_json::to_value(Scored::new(&rows, &events)));
    document.unwrap_or_else(|| Ok(json!({}))).map_err(RequestError::new)
}

/// Returns an answer with the tracks of a scenario, f64 [agents, frames, 5], NaN where absent or unknown.
fn tracks_answer(scenario: &Scenario, tracks: &[Vec<StateFrame>]) -> Answer {
    let shape = [tracks.len(), tracks.first().map_or(0, Vec::len), 5];
    let values = tracks.iter().flatten().flat_map(|frame| {
        frame.map_or([f64::NAN; 5], |state| [state.x, state.y, state.heading, state.vx, state.vy])
    });
    let ids: Vec<&str> = scenario.start.agents.iter().map(|agent| agent.id.as_str()).collect();
    let mut answer = answer("tracks", &json!({ "scenario": scenario.id, "agents": ids }))?;
    answer.tensor("states", Values::f64(&shape, values));
    Ok(answer)
}

#[cfg(test)]
mod tests {
    use super::super::scenarios::of_length;
    use super::*;
    use crate::evaluation::Source;

    #[test]
    fn pictures_show_the_present_step_of_scenarios_of_any_length() {
        let shipped = Source::shipped(1).scenarios().unwrap().next().unwrap().unwrap();
        for steps in [60, 150] {
            let scenario = of_length(&shipped, steps);
            let frames = scenario.length().frames();
            let answer = |frames: usize, every: Option<usize>| {
                let agents = 0..scenario.start.agents.len();
                let tracks: Vec<_> = agents.map(|i| scenario.logged(i)[..frames].to_vec()).collect();
                let drawing = Drawing { slot: 0, size: 100, radius: None, follow: true, every };
                let mut answer = drawing.answer(&scenario, &tracks).unwrap();
                answer.text("seq", "0");
                Frame::read(answer.to_frame().unwrap()[8..].to_vec()).unwrap()
            };
            let rgb = |frames: usize| answer(frames, None).bytes("rgb").unwrap().to_vec();
            assert_ne!(rgb(frames - 1), rgb(frames), "{steps} steps");
            assert!(answer(frames, Some(steps)).bytes("gif").unwrap().starts_with(b"GIF89a"));
        }
    }
}
