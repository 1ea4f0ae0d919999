//! Shared parts of networks that learn from scenarios: scenes and their variants, reservoir samples, and
//! the provenance of what was computed from scenarios.

mod map;
mod provenance;
mod reservoir;
mod scene;

pub(crate) use map::LearningMap;
pub use provenance::Provenance;
pub(crate) use reservoir::Reservoir;
pub(crate) use scene::LearningScene;
