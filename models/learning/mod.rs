//! Shared parts of networks that learn from scenarios: scenes and their variants, and reservoir
//! samples.

mod reservoir;
mod scene;

pub(crate) use reservoir::Reservoir;
pub(crate) use scene::{LearningMap, LearningScene};
