//! The reactive network, sized for CPUs and designed to react to the AV.
//!
//! Differences from SMART: every agent attends to a fixed number of neighbours; relations are engineered
//! features with relative velocity, closing speed, gaps and crossing times; the AV is marked on nodes
//! and relations and is known one frame ahead if the protocol shows it; motion enters as continuous
//! features, not as a token; light states enter with the relation to the places that they control.

pub(crate) mod batch;
mod cached_step;
mod choice;
mod config;
pub(crate) mod linked_places;
pub(crate) mod network;
pub(crate) mod notes;
mod pair;
mod place_relations;
mod policy;
mod scoring;
mod simulator;
mod standing;
pub(crate) mod step;
mod window;

pub use cached_step::CachedStep;
pub use config::Config;
pub use network::Network;
pub use policy::Policy;
pub use scoring::Logits;
pub use simulator::ReactiveSimulator;
