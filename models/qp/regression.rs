//! Regression: a motion predictor in the manner of MTR, whose predicted trajectories agents follow.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod entries;
mod follow;
mod inputs;
pub mod learn;
pub mod network;
mod policy;
mod predict;
mod simulator;
mod smoothed;

pub use policy::{Ground, Policy};
pub use predict::{Mode, ModePoint, Prediction};
pub use simulator::{Driving, EpisodeMemory, RegressionSimulator, predicted_slots};
pub use smoothed::{PlanningParameters, QpRegressionSimulator};
