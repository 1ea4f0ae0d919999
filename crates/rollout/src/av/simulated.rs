//! AVs that a simulator moves.

use std::collections::BTreeMap;
use std::sync::Arc;

use reactsim_geometry::Vec2;
use reactsim_scene::{AgentState, Scenario};

use super::{Av, AvError, AvPolicy};
use crate::episode::{Beginning, Continuation, Episode, Identity, JointPlan, Memory, PlanError, Simulator};
use crate::stream::after_changes;
use crate::{Observation, Purpose, Replan, Stream, stream};

/// AV that a simulator moves: it plans all agents, and the AV executes its own part of the plan.
///
/// Each rollout has an episode of its own, in which the simulator moves the AV too. Other agents are moved by
/// the controller of the rollout; the simulator observes what they did, and plans again. Its random streams
/// are its own, so that the streams of the controller are the same as with any other AV. Outcomes of its
/// plans are not counted, and a broken-off plan ([`PlanError::BrokenOff`]) is not repeated.
#[derive(Clone)]
pub struct SimulatedAv {
    simulator: Arc<dyn Simulator>,
    replan: Replan,
    seed: u64,
    /// Id of the scenario.
    scenario: String,
    origin: Vec2,
    /// Steps of a rollout.
    steps: usize,
}

impl SimulatedAv {
    /// Creates the AV of a scenario, whose id names the random streams. The simulator receives the id and the
    /// origin only if it asks for them ([`Simulator::wants_identity`]).
    pub fn new(scenario: &Scenario, simulator: Arc<dyn Simulator>, replan: Replan, seed: u64) -> Self {
        Self {
            simulator,
            replan,
            seed,
            scenario: scenario.id.clone(),
            origin: scenario.origin,
            steps: scenario.length().future,
        }
    }
}

impl Av for SimulatedAv {
    fn begin(&self, rollout: u32) -> Box<dyn AvPolicy + '_> {
        let stream = stream(self.seed, &self.scenario, rollout, Purpose::AvPlan);
        Box::new(SimulatedPolicy {
            av: self,
            rollout,
            memory: None,
            stream,
            plan: JointPlan::new(0, 0),
            next: 0,
            changes: 0,
            ids: Vec::new(),
        })
    }
}

/// The episode of one rollout.
struct SimulatedPolicy<'a> {
    av: &'a SimulatedAv,
    rollout: u32,
    /// Memory of the simulator; `None` before the episode begins.
    memory: Option<Memory>,
    stream: Stream,
    plan: JointPlan,
    /// Step of the plan that is executed next.
    next: usize,
    /// Number of renewals of the start when the episode began or continued.
    changes: usize,
    /// Ids of the agents of the episode; empty before it begins.
    ids: Vec<String>,
}

impl AvPolicy for SimulatedPolicy<'_> {
    fn history(&self) -> Option<usize> {
        self.av.simulator.history()
    }

    fn horizon(&self) -> Option<usize> {
        self.av.simulator.horizon()
    }

    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        let step = seen.step() + 1;
        let failed =
            |reason: String| AvError(format!("the simulator does not move the AV to step {step}: {reason}"));
        // Slot 0 is the AV, whatever other agents come or go.
        if self.next == self.plan.steps() {
            self.plan = self.planned(seen.without_av_next()).map_err(|error| failed(error.to_string()))?;
            self.next = 0;
        }
        let has_slot = self.plan.agents() > 0 && self.next < self.plan.steps();
        let state = if has_slot { self.plan.get(0, self.next) } else { None };
        let lacks_av = || {
            let planned_at = seen.step() - self.next;
            failed(format!(
                "its plan of step {planned_at} has no state of the AV (slot 0), which simulators plan if \
                 `moves_av` is set; choose a simulator that supports the realism protocol"
            ))
        };
        let state = state.ok_or_else(lacks_av)?;
        self.next += 1;
        Ok(state)
    }
}

impl SimulatedPolicy<'_> {
    /// Returns the plan from now on, at most up to the last step; begins the episode if it has not begun.
    fn planned(&mut self, seen: Observation<'_>) -> Result<JointPlan, PlanError> {
        let memory = match &mut self.memory {
            Some(memory) => memory,
            none => {
                let mut beginning = [beginning(self.av, self.rollout, &seen)];
                let begun = self.av.simulator.begin_batch(&mut beginning);
                let [Beginning { memory, .. }] = beginning;
                // It must be given back even if the beginning failed.
                let memory = none.insert(memory);
                self.ids = ids(&seen);
                begun?;
                memory
            }
        };
        if self.changes != seen.changes() {
            let now = ids(&seen);
            let kept: Vec<_> = now.iter().map(|id| self.ids.iter().position(|other| other == id)).collect();
            let mut continuation = [Continuation {
                before: std::mem::take(memory),
                kept: &kept,
                beginning: beginning(self.av, self.rollout, &seen),
            }];
            let continued = self.av.simulator.continue_batch(&mut continuation);
            let [Continuation { beginning, .. }] = continuation;
            *memory = beginning.memory;
            (self.changes, self.ids) = (seen.changes(), now);
            continued?;
        }
        let steps = self.av.replan.steps().min(self.av.steps - seen.step());
        let mut episode = [Episode {
            seen,
            memory,
            stream: &mut self.stream,
            moves_av: true,
            shares_traffic: true,
            plan: JointPlan::new(seen.tracks().len(), steps),
            outcomes: BTreeMap::new(),
            error: None,
        }];
        self.av.simulator.plan(&mut episode)?;
        let [episode] = episode;
        match episode.error {
            Some(error) => Err(error),
            None => Ok(episode.plan),
        }
    }
}

/// Returns the ids of the agents that are observed.
fn ids(seen: &Observation<'_>) -> Vec<String> {
    seen.start().agents.iter().map(|agent| agent.id.clone()).collect()
}

/// Returns the beginning of an episode at the start that is observed.
fn beginning<'a>(av: &'a SimulatedAv, rollout: u32, seen: &Observation<'a>) -> Beginning<'a> {
    let identity = Identity { scenario: &av.scenario, origin: av.origin, rollout };
    Beginning {
        start: seen.start(),
        stream: after_changes(stream(av.seed, &av.scenario, rollout, Purpose::AvBegin), seen.changes()),
        moves_av: true,
        steps: av.replan.steps(),
        future: av.steps,
        identity: av.simulator.wants_identity().then_some(identity),
        memory: Memory::NONE,
    }
}

impl Drop for SimulatedPolicy<'_> {
    fn drop(&mut self) {
        if let Some(memory) = self.memory.take() {
            self.av.simulator.end_batch(vec![memory]);
        }
    }
}

#[cfg(test)]
mod tests;
