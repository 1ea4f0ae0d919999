//! Regression: a motion predictor in the manner of MTR, whose predicted trajectories agents follow.

pub(super) mod entries;
mod follow;
mod inputs;
pub mod learn;
pub mod network;
mod policy;
mod predict;
mod simulator;
mod smoothed;

pub use inputs::Ground;
pub use policy::{Policy, PolicyError};
pub use predict::{Mode, ModePoint, Prediction};
pub use simulator::{Driving, RegressionSimulator, predicted_slots};
pub use smoothed::{PlanningParameters, QpRegressionSimulator};
