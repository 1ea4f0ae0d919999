//! The network.
//!
//! Tensors have the names and shapes of the public code, so that its state dict loads. [`PlannerInput`] has
//! its inputs, normalised, in the frame of the AV's rear axle.

mod config;
mod elements;
mod encoder;
mod final_layer;
mod fusion;
#[cfg(test)]
mod golden;
mod input;
mod mixer;
mod perceptron;
mod planner;
mod route;
mod time;
mod transformer;

pub use config::PlannerConfig;
pub use input::PlannerInput;
pub(super) use input::{AGENT, POINT, STATIC};
pub use planner::{DiffusionPlanner, EncodedPlan};
