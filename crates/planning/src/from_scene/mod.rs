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

use std::collections::BTreeSet;

use reactsim_scene::{Frame, Scenario};

use crate::map::{AreaError, PlanningMap, PlanningMapError};
use crate::metrics::{History, HistoryError, Label, MissingInputs, PlannerScores, judge};
use crate::{EgoShape, EgoState, TrackedObject};

pub use agent_roads::SceneRoads;
pub use ego::{ego_state_now, ego_states, ego_states_until_now};
pub(crate) use lights::LightLanes;
pub use map::{planning_lanes, planning_map};
pub(crate) use objects::{Differences, ObjectFrame};
pub use objects::{ObjectIds, kind_of, rollout_objects};
pub use route::{RouteEnd, logged_route, route_end};

/// Slot of the AV among the agents of a scenario.
const AV: usize = 0;

/// The input of the metrics for one rollout.
#[derive(Clone, Debug)]
pub struct SceneHistory {
    /// The map.
    pub map: PlanningMap,
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

/// Reason why a scenario with a rollout does not form a history.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneHistoryError {
    /// The map cannot be used.
    #[error("scenario `{scenario}`: {source}")]
    Map {
        /// Id of the scenario.
        scenario: String,
        /// Reason.
        source: SceneMapError,
    },
    /// The number of tracks differs from the number of agents.
    #[error("scenario `{scenario}`: {tracks} tracks for {agents} agents; give one track per agent")]
    Tracks {
        /// Id of the scenario.
        scenario: String,
        /// Number of agents.
        agents: usize,
        /// Number of tracks.
        tracks: usize,
    },
    /// The AV is absent or not finite at a frame of the rollout.
    #[error(
        "scenario `{scenario}`: the AV has no finite state at every frame from {first} to {last}; ego must \
         be present"
    )]
    Ego {
        /// Id of the scenario.
        scenario: String,
        /// The current frame.
        first: usize,
        /// The last frame.
        last: usize,
    },
    /// The AV has no box.
    #[error("scenario `{scenario}`: the box of the AV is {length} m × {width} m; its sides must be positive")]
    Shape {
        /// Id of the scenario.
        scenario: String,
        /// Length, metres.
        length: f64,
        /// Width, metres.
        width: f64,
    },
}

/// Reason why the map of a scenario cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneMapError {
    /// A lane has no area.
    #[error("lane `{lane}`: {source}")]
    Lane {
        /// Id of the lane.
        lane: String,
        /// Reason.
        source: AreaError,
    },
    /// A drivable polygon, an intersection or a driveway has no area.
    #[error("{list}[{index}]: {source}")]
    Area {
        /// Name of the list in the map.
        list: &'static str,
        /// Index in the list.
        index: usize,
        /// Reason.
        source: AreaError,
    },
    /// The lanes do not form a map.
    #[error(transparent)]
    Links(#[from] PlanningMapError),
}

impl SceneHistory {
    /// Creates the history of a rollout. `tracks`: the frames of each agent of the scenario, in its order.
    /// The motion of ego follows the track of the AV.
    ///
    /// # Errors
    /// [`SceneHistoryError`] if the map has lanes without area, or the AV is not present at all frames from
    /// the current one on.
    pub fn of_rollout(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Result<Self, SceneHistoryError> {
        let shape = ego_shape(scenario)?;
        let track = tracks.get(AV).map(Vec::as_slice).unwrap_or_default();
        let length = scenario.length();
        let no_ego = || SceneHistoryError::Ego {
            scenario: scenario.id.clone(),
            first: length.current(),
            last: length.frames() - 1,
        };
        let ego = ego_states(track, length, &shape).ok_or_else(no_ego)?;
        let mut history = Self::of_planner(scenario, tracks, ego)?;
        history.labels.insert(Label::EgoDifferences);
        Ok(history)
    }

    /// Creates the history of a rollout in which a controller drove ego. `ego`: a state at the current frame
    /// and at every frame after it. `tracks` as in [`Self::of_rollout`]; the AV is left out of the objects.
    ///
    /// # Errors
    /// As [`Self::of_rollout`], except for the track of the AV.
    pub fn of_planner(
        scenario: &Scenario,
        tracks: &[Vec<Frame>],
        ego: Vec<EgoState>,
    ) -> Result<Self, SceneHistoryError> {
        let agents = scenario.start.agents.len();
        if tracks.len() != agents {
            let (scenario, tracks) = (scenario.id.clone(), tracks.len());
            return Err(SceneHistoryError::Tracks { scenario, agents, tracks });
        }
        let shape = ego_shape(scenario)?;
        let mut labels = BTreeSet::new();
        if shape != EgoShape::PACIFICA {
            labels.insert(Label::VehicleScaled);
        }
        if scenario.start.has_levels() {
            labels.insert(Label::LevelsIgnored);
        }
        let map = planning_map(scenario)?;
        let objects = rollout_objects(scenario, tracks, &mut labels);
        let expert = ego_states(&scenario.logged(AV), scenario.length(), &shape);
        Ok(Self { map, shape, ego, expert, objects, labels })
    }

    /// Computes all metrics.
    ///
    /// # Errors
    /// [`HistoryError`] if the states of ego are too few, not as many as the samples, or not finite.
    pub fn judge(&self) -> Result<PlannerScores, HistoryError> {
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
/// [`SceneHistoryError::Shape`] if a side is not positive.
pub fn ego_shape(scenario: &Scenario) -> Result<EgoShape, SceneHistoryError> {
    let (length, width) = scenario.start.agents.get(AV).map_or((0.0, 0.0), |av| (av.length, av.width));
    if length > 0.0 && width > 0.0 {
        Ok(EgoShape::from_box(length, width))
    } else {
        Err(SceneHistoryError::Shape { scenario: scenario.id.clone(), length, width })
    }
}
