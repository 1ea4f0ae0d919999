//! Reactive agents: vehicles that follow their lanes and the nearest vehicle or object on them by the
//! intelligent driver model, as in closed-loop simulations of nuPlan (devkit 1.2.2, `IDMAgents`).
//!
//! Start with [`IdmAgents`], which are created from the objects of the present sample and stepped. The rules
//! are those of the devkit, the unexpected ones included: agents are put on their centre lines, are removed
//! where they start off the lanes or far from ego, and see one another with footprints that reach as far as
//! they drive in their headway.

mod agent;
mod leader;
mod placing;
mod roads;

use std::sync::Arc;

use reactsim_geometry::{OrientedBox, Vec2};
use serde::Deserialize;

use crate::contact::in_contact;
use crate::ground::Ground;
use crate::idm_model::IdmModel;
use crate::planner::Light;
use crate::{EgoShape, EgoState, ObjectId, ObjectKind, TrackedObject};

pub use agent::IdmAgent;
pub use leader::{Lead, Leader};
pub use roads::{AgentRoads, SignalLine};

use leader::Seen;
use placing::place;

/// Kinds of objects that are not agents and that agents see, in the order of the devkit.
const SEEN_KINDS: [ObjectKind; 5] = [
    ObjectKind::Pedestrian,
    ObjectKind::Barrier,
    ObjectKind::ConstructionSign,
    ObjectKind::TrafficCone,
    ObjectKind::GenericObject,
];

/// Parameters of the agents.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// Speed aimed at before a lane with a limit was seen, m/s.
    pub target_speed: f64,
    /// Gap at standstill, metres.
    pub min_gap: f64,
    /// Time headway, seconds.
    pub headway: f64,
    /// Largest acceleration, m/s².
    pub acceleration: f64,
    /// Comfortable and largest deceleration, m/s².
    pub deceleration: f64,
    /// Length that a path has at least, beyond the headway at the speed aimed at, where lanes go on, metres.
    pub min_path: f64,
    /// Distance from ego beyond which agents are removed, metres.
    pub radius: f64,
}

impl Parameters {
    fn model(&self) -> IdmModel {
        let &Self { min_gap, headway, acceleration, deceleration, .. } = self;
        IdmModel { min_gap, headway, acceleration, deceleration }
    }
}

/// Ego as the agents see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenEgo {
    /// Its box.
    pub footprint: OrientedBox,
    /// Heading, radians.
    pub heading: f64,
    /// Speed of the rear axle, m/s.
    pub speed: f64,
}

impl SeenEgo {
    /// Returns what is seen of a state.
    pub fn new(state: &EgoState, shape: &EgoShape) -> Self {
        Self { footprint: state.footprint(shape), heading: state.heading, speed: state.speed() }
    }
}

/// The surroundings of the agents during a step.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// Place from which the distance of agents is measured: the centre of ego, metres.
    pub center: Vec2,
    /// Ego before the step; `None` if ego is one of the agents.
    pub ego: Option<SeenEgo>,
    /// Objects after the step. Vehicles and bicycles among them are not seen.
    pub objects: &'a [TrackedObject],
    /// Lights after the step.
    pub lights: &'a [Light],
}

/// Reactive agents on a map.
#[derive(Clone, Debug)]
pub struct IdmAgents {
    roads: Arc<AgentRoads>,
    parameters: Parameters,
    agents: Vec<IdmAgent>,
}

impl IdmAgents {
    /// Makes agents of the vehicles among the objects of the present sample, in their order.
    ///
    /// Each is put on the centre line of its lane. Those that are in no lane, and those whose box on the
    /// centre line touches ego, an object that is seen, or an agent before it, do not become agents. A vehicle
    /// of unknown velocity (NaN) has the speed of ego.
    pub fn new(
        roads: Arc<AgentRoads>,
        parameters: Parameters,
        objects: &[TrackedObject],
        ego: Option<&SeenEgo>,
    ) -> Self {
        let mut agents = Self { roads, parameters, agents: Vec::new() };
        agents.add(objects, ego);
        agents
    }

    /// Makes agents of the vehicles among the objects that are none yet, by the rules of [`Self::new`]. In
    /// the devkit none are added after the beginning.
    pub fn add(&mut self, objects: &[TrackedObject], ego: Option<&SeenEgo>) {
        let mut taken: Vec<OrientedBox> = seen(objects).map(TrackedObject::footprint).collect();
        taken.extend(ego.map(|ego| ego.footprint));
        taken.extend(self.agents.iter().map(|agent| agent.object().footprint()));
        let speed_of_ego = ego.map_or(0.0, |ego| ego.speed);
        let mut target_speed = self.parameters.target_speed;
        for object in objects.iter().filter(|object| object.kind == ObjectKind::Vehicle) {
            let is_new = self.agents.iter().all(|agent| agent.id() != &object.id);
            let Some(place) = place(&self.roads, object).filter(|_| is_new) else { continue };
            if taken.iter().any(|other| in_contact(other, &place.footprint)) {
                continue;
            }
            taken.push(place.footprint);
            target_speed = self.roads.limit(place.lane).unwrap_or(target_speed);
            self.agents.push(IdmAgent::new(object, place, target_speed, speed_of_ego));
        }
    }

    /// Returns the agents, in the order in which they move.
    pub fn agents(&self) -> &[IdmAgent] {
        &self.agents
    }

    /// Moves all agents by one step of 0.1 s, one after the other: each sees those before it after the step,
    /// and those after it before the step. Agents that are too far away are removed before.
    pub fn step(&mut self, step: &Step<'_>) {
        let radius = self.parameters.radius;
        self.agents.retain(|agent| !((agent.pose().position - step.center).norm() > radius));
        let objects: Vec<(&TrackedObject, Ground)> =
            seen(step.objects).map(|object| (object, Ground::of_box(&object.footprint()))).collect();
        let ego = step.ego.map(|ego| (ego, Ground::of_box(&ego.footprint)));
        let model = self.parameters.model();
        for i in 0..self.agents.len() {
            self.agents[i].extend_route(&self.roads, step.lights, &self.parameters);
            let around =
                Seen { roads: &self.roads, ego: ego.as_ref(), objects: &objects, lights: step.lights };
            let lead = around.lead_of(i, &self.agents);
            self.agents[i].advance(&self.roads, &model, lead);
        }
    }

    /// Puts the agent with the id of `object` where the object is observed: on the centre line of its lane,
    /// whatever is there. An agent in no lane is removed.
    pub fn put(&mut self, object: &TrackedObject) {
        let Some(i) = self.agents.iter().position(|agent| agent.id() == &object.id) else { return };
        match place(&self.roads, object) {
            Some(place) => {
                let (target_speed, speed) = (self.agents[i].target_speed(), self.agents[i].speed());
                self.agents[i] = IdmAgent::new(object, place, target_speed, speed);
            }
            None => self.remove(&object.id),
        }
    }

    /// Removes the agent with this id.
    pub fn remove(&mut self, id: &ObjectId) {
        self.agents.retain(|agent| agent.id() != id);
    }
}

/// Returns the objects that agents see, by kind, in the order of the devkit.
pub fn seen(objects: &[TrackedObject]) -> impl Iterator<Item = &TrackedObject> {
    SEEN_KINDS.into_iter().flat_map(|kind| objects.iter().filter(move |object| object.kind == kind))
}

#[cfg(test)]
mod tests;
