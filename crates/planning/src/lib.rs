//! Closed-loop evaluation of planners on scenarios, as nuPlan defines it.
//!
//! Start with [`EgoState`], [`TrackedObject`] and [`PlanningMap`]: every planner, controller and metric
//! of this crate works on them. [`metrics::judge`] computes the metrics, and [`from_scene::SceneHistory`]
//! the input of the metrics for a rollout of a scenario. A [`planner::Planner`] is stepped in closed loop
//! by a [`closed_loop::Episode`]; [`pdm::PdmClosed`] and [`idm_planner::IdmPlanner`] are planners. In a
//! rollout, whose traffic is simulated, a planner drives the AV as an [`av::PlannerAv`].
//! [`idm_agents::IdmAgents`] is reactive traffic.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod av;
pub mod closed_loop;
pub mod from_scene;
pub mod idm_agents;
pub mod idm_planner;
pub mod map;
pub mod metrics;
pub mod pdm;
pub mod planner;
pub mod tracking;

mod contact;
mod ground;
mod idm_model;
mod objects;
mod path;
mod search;
mod shapes;
mod state;
mod trajectory;

#[cfg(test)]
mod fixtures;

pub use map::PlanningMap;
pub use objects::{ObjectGroup, ObjectId, ObjectKind, TrackedObject};
pub use path::Path;
pub use state::{EgoShape, EgoState};
pub use trajectory::{MAX_SPEED, MAX_START_DISTANCE, Pose, STEP, Trajectory, TrajectoryError, validate};

/// The reason why a map, a history or a plan cannot be used, with its place and a remedy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PlanningError(pub String);
