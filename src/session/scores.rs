//! Scores of rollouts in memory.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::scenarios::{Reading, ScenarioCache};
use super::wire::{Answer, RequestError, answer, arguments, refused};
use crate::evaluation::{EventLine, Pose, RolloutCheck, Row, score_in_memory};
use crate::external::Frame;
use crate::formats::rollouts::RolloutRecord;
use crate::metrics::{Event, Options};
use crate::scene::{AgentState, Frame as StateFrame};

/// Values of a state: x, y, heading, and the velocities, which may be left out.
const VALUES: [usize; 2] = [3, 5];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScoreArguments {
    /// Files of the scenario.
    reading: Reading,
    /// Id of the scenario.
    scenario: String,
    /// Name of the simulator.
    simulator: String,
    /// Ids of the agents of the states; by default the agents of the scenario.
    agents: Option<Vec<String>>,
    /// Names of checks that need not be met.
    allow: Vec<String>,
    /// The point of vehicles whose poses are given.
    pose: Option<String>,
    /// Variants of the metrics.
    metric_options: BTreeMap<String, String>,
}

/// Scores the rollouts of a request: the tensor `states`, [rollouts, agents, steps of the scenario, 3 or 5],
/// NaN where an agent is absent.
pub(super) fn score(request: &Frame, scenarios: &mut ScenarioCache) -> Answer {
    let given: ScoreArguments = arguments(request)?;
    let options = metric_options(&given.metric_options)?;
    let pose: Pose = given.pose.as_deref().map_or(Ok(Pose::Centre), str::parse).map_err(RequestError::new)?;
    let allowance = |name: &String| -> Result<RolloutCheck, RequestError> {
        name.parse().map_err(|error| RequestError::new(format_args!("unknown check `{name}`: {error}")))
    };
    let allowed = given.allow.iter().map(allowance).collect::<Result<Vec<_>, _>>()?;
    let known = scenarios.find(&given.reading, &given.scenario)?;
    let scenario = &known.scenario;
    let of_scenario = || scenario.start.agents.iter().map(|agent| agent.id.clone()).collect();
    let agents: Vec<String> = given.agents.unwrap_or_else(of_scenario);
    let (count, tracks) = read_states(request, agents.len(), scenario.length().future)?;
    let record = |(rollout, tracks): (u32, &[Vec<StateFrame>])| RolloutRecord {
        scenario_id: scenario.id.clone(),
        simulator: given.simulator.clone(),
        rollout,
        origin: None,
        agent_ids: agents.clone(),
        tracks: tracks.to_vec(),
    };
    let records: Vec<RolloutRecord> =
        (0..).zip(tracks.chunks(agents.len().max(1))).take(count).map(record).collect();
    let (rows, events) = score_in_memory(scenario, &known.digest, records, options, pose, &allowed)?;
    answer("scores", &Scored::new(&rows, &events))
}

/// Rows of rollouts, of which the last one is over all, and the events of each rollout.
#[derive(Serialize)]
pub(super) struct Scored<'a> {
    rows: &'a [Row],
    events: Vec<Vec<EventLine>>,
}

impl<'a> Scored<'a> {
    pub(super) fn new(rows: &'a [Row], events: &[Vec<Event>]) -> Self {
        let of_rollout = |(rollout, (row, events)): (u32, (&Row, &Vec<Event>))| {
            events.iter().map(|event| EventLine::new(row, rollout, event)).collect()
        };
        Self { rows, events: (0..).zip(rows.iter().zip(events)).map(of_rollout).collect() }
    }
}

/// Returns the variants of the metrics with these names and values.
pub(super) fn metric_options(named: &BTreeMap<String, String>) -> Result<Options, RequestError> {
    let mut options = Options::default();
    for (name, value) in named {
        options.set(name, value).map_err(RequestError::new)?;
    }
    Ok(options)
}

/// Returns the number of rollouts, and the tracks of their agents one after the other.
fn read_states(
    request: &Frame,
    agents: usize,
    steps: usize,
) -> Result<(usize, Vec<Vec<StateFrame>>), RequestError> {
    let shape = request.shape("states")?;
    let (rollouts, values) = match shape {
        &[rollouts, n, k, values] if (n, k) == (agents, steps) && VALUES.contains(&values) => {
            (rollouts, values)
        }
        found => {
            return refused(format_args!(
                "`states` has the shape {found:?}, expected [rollouts, {agents}, {steps}, 3 or 5] for the \
                 {agents} agents"
            ));
        }
    };
    let shape = shape.to_vec();
    let numbers = request.floats("states", &shape)?;
    let state = |values: &[f64]| {
        let [x, y, heading] = [values[0], values[1], values[2]];
        let (vx, vy) =
            (values.get(3).copied().unwrap_or(f64::NAN), values.get(4).copied().unwrap_or(f64::NAN));
        (!x.is_nan()).then_some(AgentState { x, y, heading, vx, vy })
    };
    let track = |numbers: &[f64]| numbers.chunks(values).map(state).collect();
    Ok((rollouts, numbers.chunks(steps * values).map(track).collect()))
}
