//! Histories of rollouts: the map, the objects, ego and the expert of a scenario as the metrics need them.
//!
//! The samples are the current frame of the scenario and the frames after it. Inputs that a scenario does not
//! record are replaced, and each replacement has a [`Label`].

mod agent_roads;
mod ego;
mod lights;
mod map;
mod objects;
mod pieces;
mod roadblocks;
mod route;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::sync::Arc;

use reactsim_scene::{Frame, Scenario};

use crate::map::PlanningMap;
use crate::metrics::{History, Label, MissingInputs, PlannerScores, judge};
use crate::{EgoShape, EgoState, PlanningError, TrackedObject};

pub use agent_roads::SceneRoads;
pub use ego::{ego_state_now, ego_states, ego_states_until_now};
pub(crate) use lights::LightLanes;
pub use map::{planning_lanes, planning_map};
pub(crate) use objects::{Differences, ObjectFrame};
pub use objects::{ObjectIds, agent_object, rollout_objects};
pub use route::{RouteEnd, logged_route, route_end};

/// Slot of the AV among the agents of a scenario.
const AV: usize = 0;

/// The input of the metrics for one rollout.
#[derive(Clone, Debug)]
pub struct SceneHistory {
    /// The map.
    pub map: Arc<PlanningMap>,
    /// Box and axles of ego.
    pub shape: EgoShape,
    /// State of ego per sample.
    pub ego: Vec<EgoState>,
    /// State of the logged AV per sample; `None` if its log has gaps.
    pub expert: Option<Vec<EgoState>>,
    /// Objects present, per sample.
    pub objects: Vec<Vec<TrackedObject>>,
    /// Replacements of inputs that the scenario does not record.
    pub labels: BTreeSet<Label>,
}

impl SceneHistory {
    /// Creates the history of a rollout. `tracks`: the frames of each agent of the scenario, in its order.
    /// The motion of ego follows the track of the AV.
    ///
    /// # Errors
    /// [`PlanningError`] if the map has lanes without area, or the AV is not present at all frames from
    /// the current one on.
    pub fn of_rollout(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Result<Self, PlanningError> {
        Self::on_map(scenario, tracks, || Ok(Arc::new(planning_map(scenario)?)))
    }

    /// Creates the history of a rollout as [`Self::of_rollout`] does, on the [`planning_map`] of the scenario
    /// that `map` returns: rollouts of a scenario can share it.
    ///
    /// # Errors
    /// As [`Self::of_rollout`], and those of `map`.
    pub fn on_map(
        scenario: &Scenario,
        tracks: &[Vec<Frame>],
        map: impl FnOnce() -> Result<Arc<PlanningMap>, PlanningError>,
    ) -> Result<Self, PlanningError> {
        let shape = ego_shape(scenario)?;
        let track = tracks.get(AV).map(Vec::as_slice).unwrap_or_default();
        let length = scenario.length();
        let no_ego = || {
            let (first, last) = (length.current(), length.frames() - 1);
            PlanningError(format!(
                "scenario `{}`: the AV has no finite state at every frame from {first} to {last}; ego must be \
                 present",
                scenario.id
            ))
        };
        let ego = ego_states(track, length, &shape).ok_or_else(no_ego)?;
        let agents = scenario.start.agents.len();
        if tracks.len() != agents {
            let (id, tracks) = (&scenario.id, tracks.len());
            let text =
                format!("scenario `{id}`: {tracks} tracks for {agents} agents; give one track per agent");
            return Err(PlanningError(text));
        }
        let mut labels = BTreeSet::from([Label::EgoDifferences]);
        if shape != EgoShape::PACIFICA {
            labels.insert(Label::VehicleScaled);
        }
        if scenario.start.has_levels() {
            labels.insert(Label::LevelsIgnored);
        }
        let map = map()?;
        let objects = rollout_objects(scenario, tracks, &mut labels);
        let expert = ego_states(&scenario.logged(AV), scenario.length(), &shape);
        Ok(Self { map, shape, ego, expert, objects, labels })
    }

    /// Computes all metrics.
    ///
    /// # Errors
    /// [`PlanningError`] if the states of ego are too few, not as many as the samples, or not finite.
    pub fn judge(&self) -> Result<PlannerScores, PlanningError> {
        let mut scores = judge(&self.history())?;
        scores.labels.extend(&self.labels);
        Ok(scores)
    }

    /// Returns the end of the route of the scenario, if ego has to brake for it in the last sample
    /// ([`route_end`]).
    pub fn route_end(&self, scenario: &Scenario) -> Option<RouteEnd> {
        route_end(scenario, &self.map, &self.shape, self.ego.last()?)
    }

    fn history(&self) -> History<'_> {
        History {
            map: &self.map,
            shape: self.shape,
            ego: &self.ego,
            expert: self.expert.as_deref(),
            objects: &self.objects,
            missing: MissingInputs::Undefined,
        }
    }
}

/// Returns the shape of the AV: its recorded box, with axles as in nuPlan's vehicle.
///
/// # Errors
/// [`PlanningError`] if a side is not positive.
pub fn ego_shape(scenario: &Scenario) -> Result<EgoShape, PlanningError> {
    let (length, width) = scenario.start.agents.get(AV).map_or((0.0, 0.0), |av| (av.length, av.width));
    if length > 0.0 && width > 0.0 {
        Ok(EgoShape::from_box(length, width))
    } else {
        Err(PlanningError(format!(
            "scenario `{}`: the box of the AV is {length} m × {width} m; its sides must be positive",
            scenario.id
        )))
    }
}
