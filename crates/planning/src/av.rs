//! The AV of a rollout, driven by a planner.
//!
//! Start with [`PlannerAv`]. Its policy steps the planner as [`closed_loop::Episode`](crate::closed_loop)
//! does: with the log as traffic, both give the same states of ego.

mod choice;

use std::fmt;

use reactsim_geometry::{direction, left};
use reactsim_rollout::{Av, AvError, AvPolicy, MAX_STEP_DISPLACEMENT, Observation, Replan};
use reactsim_scene::{AgentState, Scenario, Start};

use crate::closed_loop::{Episode, Now, no_history};
use crate::from_scene::{
    Differences, LightLanes, ObjectFrame, ObjectIds, ego_shape, ego_states_until_now, logged_route,
    planning_map,
};
use crate::planner::{History, Light, Planner, Route, Sample};
use crate::tracking::Controller;
use crate::trajectory::Trajectory;
use crate::{EgoShape, EgoState, PlanningError, PlanningMap};

pub use choice::PlannerChoice;

/// Slot of the AV among the agents of a scenario.
const AV: usize = 0;
/// Time at the current frame, seconds.
const START_TIME: f64 = 0.0;

/// Creates a planner for the rollout with this index among the rollouts of the scenario.
type NewPlanner = Box<dyn Fn(u32) -> Box<dyn Planner> + Send + Sync>;

/// AV that a planner drives in closed loop: the planner observes the realised traffic and plans
/// trajectories, which a controller tracks.
///
/// The map, the box and the route ([`logged_route`]) belong to one scenario. Each rollout has a planner of
/// its own. Of the logged future, the planner receives the roadblocks of the route only.
pub struct PlannerAv {
    scenario: String,
    new_planner: NewPlanner,
    controller: Controller,
    plan_every: Replan,
    /// Steps of a rollout.
    steps: usize,
    map: PlanningMap,
    shape: EgoShape,
    route: Route,
    lights: LightLanes,
}

impl PlannerAv {
    /// Creates the AV of a scenario. `plan_every`: number of steps between plans; trajectories are kept in
    /// between.
    ///
    /// # Errors
    /// [`PlanningError`] if the map has no lanes or an outline without area, the AV has no box, or the
    /// controller cannot follow the planner.
    pub fn new(
        scenario: &Scenario,
        planner: PlannerChoice,
        controller: Controller,
        plan_every: Replan,
    ) -> Result<Self, PlanningError> {
        if controller == Controller::PerfectTracking && planner.plans_poses_only() {
            return Err(PlanningError(format!(
                "planner `{}` returns poses without velocities, which perfect tracking cannot follow; choose \
                 the LQR tracker with the bicycle",
                planner.id()
            )));
        }
        Self::with_planner(scenario, move |_| planner.new_planner(), controller, plan_every)
    }

    /// Creates the AV of a scenario with any planner. `new_planner` is called once per rollout, with the
    /// index of the rollout among those of the scenario.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_planner(
        scenario: &Scenario,
        new_planner: impl Fn(u32) -> Box<dyn Planner> + Send + Sync + 'static,
        controller: Controller,
        plan_every: Replan,
    ) -> Result<Self, PlanningError> {
        let (shape, map) = (ego_shape(scenario)?, planning_map(scenario)?);
        let no_route = || {
            PlanningError(format!(
                "scenario `{}`: the map has no lanes for motor vehicles, so there is no route for a planner; \
                 choose an AV that needs no lanes, such as `constant-velocity`",
                scenario.id
            ))
        };
        Ok(Self {
            scenario: scenario.id.clone(),
            new_planner: Box::new(new_planner),
            controller,
            plan_every,
            steps: scenario.length().future,
            route: logged_route(scenario, &map, &shape).ok_or_else(no_route)?,
            map,
            shape,
            lights: LightLanes::new(&scenario.start),
        })
    }

    /// Returns the map of the planner.
    pub fn map(&self) -> &PlanningMap {
        &self.map
    }

    /// Returns the route of the planner.
    pub fn route(&self) -> &Route {
        &self.route
    }

    /// Returns box and axles of the AV.
    pub fn shape(&self) -> &EgoShape {
        &self.shape
    }
}

impl fmt::Debug for PlannerAv {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PlannerAv")
            .field("scenario", &self.scenario)
            .field("controller", &self.controller)
            .field("plan_every", &self.plan_every)
            .field("route", &self.route)
            .finish_non_exhaustive()
    }
}

impl Av for PlannerAv {
    fn begin(&self, rollout: u32) -> Box<dyn AvPolicy + '_> {
        Box::new(PlannerPolicy {
            av: self,
            planner: (self.new_planner)(rollout),
            ids: None,
            samples: Vec::new(),
            next: None,
            iteration: 0,
            trajectory: None,
        })
    }
}

/// The planner of one rollout.
struct PlannerPolicy<'a> {
    av: &'a PlannerAv,
    planner: Box<dyn Planner>,
    /// Ids of the objects, with the number of times that agents had entered or left.
    ids: Option<(usize, ObjectIds)>,
    /// The last two seconds.
    samples: Vec<Sample>,
    /// State of ego at the frame that is observed next; `None` before the first one. The states of the
    /// rollout are boxes, without steering angle, time and accelerations.
    next: Option<EgoState>,
    /// Step that is observed next.
    iteration: usize,
    trajectory: Option<Trajectory>,
}

impl AvPolicy for PlannerPolicy<'_> {
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        let iteration = self.iteration;
        let failed = |reason: String| AvError::planner(seen.step() + 1, &reason);
        if seen.step() != iteration {
            return Err(failed(format!(
                "it observes step {} after {iteration} steps; observe every step once, in order",
                seen.step()
            )));
        }
        self.observe(seen);
        let next =
            self.advance(&self.av.lights.now(seen), seen).map_err(|error| failed(error.to_string()))?;
        let state = state_of_box(&next, &self.av.shape);
        let metres = seen.state(AV).map_or(0.0, |now| (state.position() - now.position()).norm());
        if metres > MAX_STEP_DISPLACEMENT {
            return Err(AvError::jump(iteration + 1, metres));
        }
        self.next = Some(next);
        self.iteration += 1;
        Ok(state)
    }
}

impl PlannerPolicy<'_> {
    /// Adds the present sample to the history; at first, the samples of the recorded history.
    fn observe(&mut self, seen: &Observation<'_>) {
        let (start, tracks) = (seen.start(), seen.tracks());
        let known = self.ids.take().filter(|(changes, _)| *changes == seen.changes());
        let (_, ids) = self.ids.insert(known.unwrap_or_else(|| (seen.changes(), ObjectIds::new(start))));
        // The objects at a frame up to the present one, as they were known at that frame.
        let objects = |frame: usize, heights: &[f64]| {
            ObjectFrame { start, ids, tracks, frame, heights }.objects(Differences::Backward, None).0
        };
        match self.next {
            Some(ego) => {
                let objects = objects(seen.frame(), &seen.heights());
                self.samples.push(Sample { ego, objects });
                let outdated = self.samples.len().saturating_sub(History::SAMPLES);
                self.samples.drain(..outdated);
            }
            None => {
                let states = ego_states_until_now(seen.track(AV), &self.av.shape);
                let current = seen.start().current();
                let first = current + 1 - states.len();
                let sample = |(frame, ego): (usize, EgoState)| {
                    if frame == current {
                        Sample { ego: at_start(ego), objects: objects(frame, &seen.heights()) }
                    } else {
                        Sample { ego, objects: objects(frame, &recorded_heights(seen.start(), frame)) }
                    }
                };
                self.samples = (first..).zip(states).map(sample).collect();
            }
        }
    }

    /// Returns the next state of ego.
    fn advance(&mut self, lights: &[Light], seen: &Observation<'_>) -> Result<EgoState, PlanningError> {
        let av = self.av;
        let episode = Episode {
            map: &av.map,
            route: &av.route,
            shape: &av.shape,
            controller: av.controller,
            steps: av.steps,
            replan_interval: av.plan_every.steps(),
        };
        let (iteration, samples) = (self.iteration, self.samples.as_slice());
        let now = Now { iteration, samples, lights, seen: Some(*seen) };
        let trajectory = episode.trajectory(&now, self.planner.as_mut(), self.trajectory.as_ref())?;
        let ego = self.samples.last().ok_or_else(no_history)?.ego;
        let next = episode.next_ego(iteration, START_TIME, &ego, &trajectory)?;
        self.trajectory = Some(trajectory);
        Ok(next)
    }
}

/// Returns the state with which an episode begins: nuPlan sets steering angle, yaw rate and yaw acceleration
/// to 0, even in a bend (devkit 1.2.2).
pub fn at_start(ego: EgoState) -> EgoState {
    EgoState { steering: 0.0, yaw_rate: 0.0, yaw_acceleration: 0.0, ..ego }
}

/// Returns the height of each agent at a frame of the history, metres; empty in scenarios of one level.
fn recorded_heights(start: &Start, frame: usize) -> Vec<f64> {
    let agents = if start.has_levels() { start.agents.len() } else { 0 };
    (0..agents).map(|agent| start.recorded_height(agent, frame)).collect()
}

/// Returns the state of the box of ego: its centre, and the velocity of its centre.
pub fn state_of_box(ego: &EgoState, shape: &EgoShape) -> AgentState {
    let (center, ahead) = (ego.center(shape), direction(ego.heading));
    let sideways = ego.vy + ego.yaw_rate * shape.rear_axle_to_center;
    let velocity = ahead * ego.vx + left(ahead) * sideways;
    AgentState { x: center.x, y: center.y, heading: ego.heading, vx: velocity.x, vy: velocity.y }
}

#[cfg(test)]
mod tests;
