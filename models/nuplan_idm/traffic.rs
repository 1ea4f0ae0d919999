//! The traffic of one episode: reactive vehicles, and everything that keeps its velocity.

use std::sync::Arc;

use reactsim_geometry::{Vec2, wrap};
use reactsim_planning::from_scene::{ObjectIds, SceneRoads, agent_object, ego_state_now};
use reactsim_planning::idm_agents::{IdmAgents, Parameters, SeenEgo, Step};
use reactsim_planning::planner::Light;
use reactsim_planning::{EgoShape, PlanningError, TrackedObject};
use reactsim_rollout::{Observation, PlanError, Planning};
use reactsim_scene::{AgentKind, AgentState, DT, Frame, Start};

/// Slot of the AV among the agents of a scenario.
const AV: usize = 0;
/// Number of frames from which the motion of the AV is estimated.
const RECENT: usize = 3;

/// State of the model in an episode.
#[derive(Clone, Debug)]
pub struct Traffic {
    roads: Result<SceneRoads, PlanningError>,
    ids: ObjectIds,
    /// Reactive vehicles; `None` before the first plan.
    vehicles: Option<IdmAgents>,
    /// State per slot after the last executed step of the last plan.
    states: Vec<Frame>,
    /// Slots of the agents that entered since then.
    entered: Vec<usize>,
}

/// A plan in the making.
struct Moving<'a> {
    start: &'a Start,
    ids: &'a ObjectIds,
    moves_av: bool,
    obstacles: Vec<TrackedObject>,
    lights: Vec<Light>,
    /// The AV before each step; empty if the vehicles do not see it, or if it is one of them.
    av: Vec<SeenEgo>,
    vehicles: IdmAgents,
    states: Vec<Frame>,
}

impl Traffic {
    pub(super) fn begin(start: &Start) -> Self {
        let states = vec![None; start.agents.len()];
        Self {
            roads: SceneRoads::new(start),
            ids: ObjectIds::new(start),
            vehicles: None,
            states,
            entered: Vec::new(),
        }
    }

    /// Returns the state with other agents. `kept`: the slots that they had before; the others are put on the
    /// lanes at the next plan.
    pub(super) fn resumed(mut self, kept: &[Option<usize>], start: &Start) -> Self {
        if let Some(vehicles) = &mut self.vehicles {
            let is_gone = |slot: &usize| !kept.contains(&Some(*slot));
            (0..self.states.len()).filter(is_gone).for_each(|slot| vehicles.remove(self.ids.agent(slot)));
        }
        let states = kept.iter().map(|slot| self.states[(*slot)?]).collect();
        let is_new = |slot: &usize| kept[*slot].is_none_or(|before| self.entered.contains(&before));
        let entered = (0..kept.len()).filter(is_new).collect();
        Self { ids: ObjectIds::new(start), states, entered, ..self }
    }

    /// Plans all steps of an episode's plan.
    pub(super) fn plan(
        &mut self,
        parameters: &Parameters,
        episode: &mut Planning<'_, '_>,
    ) -> Result<(), PlanError> {
        let (seen, moves_av, steps) = (episode.seen, episode.moves_av, episode.plan.steps());
        let av = if moves_av { Vec::new() } else { av_at(&seen, steps) };
        let moved = self.observe(&seen);
        let roads = self.roads.as_ref();
        let roads = roads.map_err(|error| PlanError::Failed(format!("the map cannot be used: {error}")))?;
        let obstacles: Vec<TrackedObject> =
            self.ids.obstacles(seen.start()).filter(TrackedObject::is_finite).collect();
        let slots = usize::from(!moves_av)..self.states.len();
        let object = |slot| object(seen.start(), &self.ids, slot, self.states[slot]);
        let vehicles = if let Some(mut vehicles) = self.vehicles.take() {
            for slot in moved.into_iter().filter(|slot| slots.contains(slot)) {
                match object(slot) {
                    Some(object) => vehicles.put(&object),
                    None => vehicles.remove(self.ids.agent(slot)),
                }
            }
            let entered: Vec<TrackedObject> =
                std::mem::take(&mut self.entered).into_iter().filter_map(object).collect();
            vehicles.add(&entered, av.first());
            vehicles
        } else {
            let objects: Vec<TrackedObject> =
                slots.clone().filter_map(object).chain(obstacles.iter().cloned()).collect();
            IdmAgents::new(Arc::clone(&roads.roads), *parameters, &objects, av.first())
        };
        let mut moving = Moving {
            start: seen.start(),
            ids: &self.ids,
            moves_av,
            obstacles,
            lights: roads.lights_now(&seen),
            av,
            vehicles,
            states: self.states.clone(),
        };
        for step in 0..steps {
            moving.advance(step);
            for slot in slots.clone() {
                episode.plan.set(slot, step, moving.states[slot]);
            }
            if step + 1 == episode.plan.executed() {
                self.vehicles = Some(moving.vehicles.clone());
                self.states.clone_from(&moving.states);
            }
        }
        Ok(())
    }

    /// Takes over the states of agents that did not execute their plans, and returns their slots.
    fn observe(&mut self, seen: &Observation<'_>) -> Vec<usize> {
        let pose = |state: Frame| state.map(|state| (state.x, state.y, state.heading));
        let mut moved = Vec::new();
        for (slot, state) in self.states.iter_mut().enumerate() {
            let now = seen.state(slot).filter(AgentState::is_finite);
            if pose(*state) != pose(now) {
                *state = now;
                moved.push(slot);
            }
        }
        moved
    }
}

impl Moving<'_> {
    /// Moves everything by one step of the plan.
    fn advance(&mut self, step: usize) {
        let ego = self.av.get(step).copied();
        let place_of_av = || self.states[AV].map_or_else(Vec2::zeros, |av| av.position());
        let center = ego.map_or_else(place_of_av, |ego| ego.footprint.center);
        let slots = usize::from(!self.moves_av)..self.states.len();
        for slot in slots.clone() {
            if self.start.agents[slot].kind != AgentKind::Other {
                self.states[slot] = self.states[slot].map(AgentState::coasted);
            }
        }
        let object = |slot| object(self.start, self.ids, slot, self.states[slot]);
        let objects: Vec<TrackedObject> =
            slots.filter_map(object).chain(self.obstacles.iter().cloned()).collect();
        self.vehicles.step(&Step { center, ego, objects: &objects, lights: &self.lights });
        for vehicle in self.vehicles.agents() {
            let TrackedObject { id, center, heading, velocity, .. } = vehicle.object();
            if let Some(slot) = self.ids.slot(&id) {
                let (vx, vy) = (velocity.x, velocity.y);
                self.states[slot] = Some(AgentState { x: center.x, y: center.y, heading, vx, vy });
            }
        }
    }
}

/// Returns an agent as an object, its velocity NaN if unknown; `None` if it is absent or has no extent.
fn object(start: &Start, ids: &ObjectIds, slot: usize, state: Frame) -> Option<TrackedObject> {
    let (agent, state) = (&start.agents[slot], state?);
    let velocity = Vec2::new(state.vx, state.vy);
    let wrapped = AgentState { heading: wrap(state.heading), ..state };
    agent.has_extent().then(|| agent_object(ids.agent(slot), agent, &wrapped, velocity))
}

/// Returns the AV before each of the next steps: at present, its next state if that is known, and then at
/// constant velocity. Empty if it is absent or has no extent.
fn av_at(seen: &Observation<'_>, steps: usize) -> Vec<SeenEgo> {
    let (av, track) = (&seen.start().agents[AV], seen.track(AV));
    if !av.has_extent() {
        return Vec::new();
    }
    let shape = EgoShape::from_box(av.length, av.width);
    let at = |frames: &[Frame]| {
        ego_state_now(frames, seen.start().current(), &shape).map(|state| SeenEgo::new(&state, &shape))
    };
    let recent = &track[track.len().saturating_sub(RECENT)..];
    let next = seen.av_next().and_then(|next| at(&[recent, &[Some(next)]].concat()));
    let mut all: Vec<SeenEgo> = at(recent).into_iter().collect();
    if all.is_empty() {
        return all;
    }
    all.extend(next);
    let velocity = seen.av_next().or(seen.state(AV)).and_then(|state| state.velocity()).unwrap_or_default();
    while let Some(&last) = all.last().filter(|_| all.len() < steps) {
        let mut moved = last;
        moved.footprint.center += velocity * DT;
        all.push(moved);
    }
    all
}
