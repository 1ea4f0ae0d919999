//! The interface of planners: what a planner observes, and what it returns.
//!
//! A planner receives a [`PlannerInput`] at each iteration. It contains the past and the present only: no
//! part of it refers to recorded states after the present time.

use reactsim_rollout::Observation;

use crate::trajectory::{STEP, Trajectory, TrajectoryError};
use crate::{EgoShape, EgoState, PlanningError, PlanningMap, TrackedObject};

/// Length of the history that planners observe, seconds (nuPlan devkit 1.2.2, `history_buffer_duration`).
pub const HISTORY: f64 = 2.0;

/// State of the traffic light of a connector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightState {
    /// Drivers may go.
    Green,
    /// Drivers have to stop if they can.
    Yellow,
    /// Drivers have to stop.
    Red,
    /// Not observed, or a signal that planners have no rule for.
    Unknown,
}

/// The traffic light of one connector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Light {
    /// The connector: index into [`PlanningMap::lanes`].
    pub lane: usize,
    /// Its state.
    pub state: LightState,
}

/// The route of ego: roadblocks in driving order, without repetitions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Route {
    roadblocks: Vec<usize>,
}

impl Route {
    /// Creates a route from the ids of roadblocks in driving order; repetitions are dropped.
    ///
    /// # Errors
    /// [`PlanningError`] if there are no ids or the map has no roadblock with one of them.
    pub fn new<'a>(map: &PlanningMap, ids: impl IntoIterator<Item = &'a str>) -> Result<Self, PlanningError> {
        let unknown = |id: &str| {
            PlanningError(format!(
                "roadblock `{id}` of the route is not in the map; remove it from the route or add it to the map"
            ))
        };
        let find = |id: &str| map.find_roadblock(id).ok_or_else(|| unknown(id));
        let roadblocks: Vec<usize> = ids.into_iter().map(find).collect::<Result<_, _>>()?;
        let empty = || PlanningError("route is empty; it needs the roadblock in which ego is".to_owned());
        Self::of_roadblocks(roadblocks).ok_or_else(empty)
    }

    /// Creates a route from indices of roadblocks of a map in driving order; repetitions are dropped. `None`
    /// without roadblocks.
    pub(crate) fn of_roadblocks(indices: impl IntoIterator<Item = usize>) -> Option<Self> {
        let mut roadblocks = Vec::new();
        for roadblock in indices {
            if !roadblocks.contains(&roadblock) {
                roadblocks.push(roadblock);
            }
        }
        (!roadblocks.is_empty()).then_some(Self { roadblocks })
    }

    /// Returns the roadblocks: indices into [`PlanningMap::roadblocks`], at least one.
    pub fn roadblocks(&self) -> &[usize] {
        &self.roadblocks
    }

    /// Returns the lanes of the roadblocks in driving order: indices into [`PlanningMap::lanes`].
    pub fn lanes(&self, map: &PlanningMap) -> Vec<usize> {
        self.roadblocks.iter().flat_map(|&block| map.lanes_of_roadblock(block)).copied().collect()
    }
}

/// Ego and the objects around it at one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// State of ego.
    pub ego: EgoState,
    /// Objects, without ego.
    pub objects: Vec<TrackedObject>,
}

/// Samples of the last [`HISTORY`] seconds at intervals of [`STEP`], the present one last.
#[derive(Clone, Copy, Debug)]
pub struct History<'a> {
    past: &'a [Sample],
    present: &'a Sample,
}

impl<'a> History<'a> {
    /// Number of samples of a full history.
    pub const SAMPLES: usize = (HISTORY / STEP) as usize + 1;

    /// Returns the last [`Self::SAMPLES`] of `samples`, whose last one is the present; `None` without
    /// samples.
    pub fn new(samples: &'a [Sample]) -> Option<Self> {
        let first = samples.len().saturating_sub(Self::SAMPLES);
        let (present, past) = samples[first..].split_last()?;
        Some(Self { past, present })
    }

    /// Returns the samples before the present one, oldest first; fewer where the recording begins later.
    pub fn past(&self) -> &'a [Sample] {
        self.past
    }

    /// Returns the present sample.
    pub fn present(&self) -> &'a Sample {
        self.present
    }
}

/// The observation of a planner at one iteration.
#[derive(Clone, Copy, Debug)]
pub struct PlannerInput<'a> {
    /// Number of the iteration, from 0. At iteration 0 planners find their path; they may keep it
    /// afterwards.
    pub iteration: usize,
    /// The last two seconds.
    pub history: History<'a>,
    /// Traffic lights at present.
    pub lights: &'a [Light],
    /// Route.
    pub route: &'a Route,
    /// Map.
    pub map: &'a PlanningMap,
    /// Box and axles of ego.
    pub shape: &'a EgoShape,
    /// The states in the vocabulary of simulators, for planners that are written for it. `None` where no
    /// rollout is the traffic.
    pub seen: Option<Observation<'a>>,
}

impl<'a> PlannerInput<'a> {
    /// Returns the present state of ego.
    pub fn ego(&self) -> &'a EgoState {
        &self.history.present().ego
    }

    /// Returns the objects at present.
    pub fn objects(&self) -> &'a [TrackedObject] {
        &self.history.present().objects
    }

    /// Returns the connectors whose light is red.
    pub fn red_connectors(&self) -> impl Iterator<Item = usize> + 'a {
        self.lights.iter().filter(|light| light.state == LightState::Red).map(|light| light.lane)
    }
}

impl From<TrajectoryError> for PlanningError {
    fn from(error: TrajectoryError) -> Self {
        Self(format!("planned states are not a trajectory: {error}"))
    }
}

/// Returns the error of a planner that is not asked from iteration 0 on.
pub(crate) fn not_started(input: &PlannerInput<'_>) -> PlanningError {
    PlanningError(format!("first plan is at iteration {}; planners start at iteration 0", input.iteration))
}

/// Returns the error of a route whose roadblocks, of which there are `count`, have no lanes.
pub(crate) fn no_lanes(count: usize) -> PlanningError {
    PlanningError(format!(
        "route has no lanes: its {count} roadblocks are empty; a route needs lanes from ego to the goal"
    ))
}

/// Returns the error of a path from a lane that has no length.
pub(crate) fn no_path(map: &PlanningMap, lane: usize) -> PlanningError {
    let id = &map.lane(lane).id;
    PlanningError(format!("path from lane `{id}` has no length; its baseline needs two distinct points"))
}

/// A planner: drives ego along a route, from what was observed up to the present.
///
/// A planner is created for one scenario, and plans at iterations 0, 1, … of one simulation.
pub trait Planner: Send {
    /// Returns the trajectory from the present on.
    ///
    /// # Errors
    /// [`PlanningError`] if the input does not allow a plan. The scenario is then over.
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError>;
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    #[test]
    fn a_history_is_at_most_two_seconds_long() {
        let sample = |i: usize| Sample {
            ego: EgoState { time: STEP * i as f64, ..EgoState::standing(Vec2::zeros(), 0.0) },
            objects: Vec::new(),
        };
        let samples: Vec<Sample> = (0..40).map(sample).collect();
        let history = History::new(&samples).unwrap();
        assert_eq!(history.past().len(), 20);
        assert!((history.present().ego.time - 3.9).abs() < 1e-12);
        assert!((history.past()[0].ego.time - 1.9).abs() < 1e-12);
        assert_eq!(History::new(&samples[..3]).unwrap().past().len(), 2);
        assert!(History::new(&[]).is_none());
    }
}
