//! Shared parts of networks that learn from scenarios.
//!
//! A `LearningScene` is a logged scenario with map data of a network, which can be mirrored and
//! stretched (`LearningMap`) and viewed from any frame. A `Reservoir` is a random sample of bounded
//! size. [`Provenance`] describes what was computed from scenarios.

mod map;
mod provenance;
mod reservoir;
mod scene;

pub(crate) use map::LearningMap;
pub use provenance::Provenance;
pub(crate) use reservoir::Reservoir;
pub(crate) use scene::{LearningScene, shifted};
