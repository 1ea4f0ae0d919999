//! The reactive network, sized for CPUs and designed to react to the AV.
//!
//! Differences from SMART: every agent attends to a fixed number of neighbours; relations are engineered
//! features with relative velocity, closing speed, gaps and crossing times; the AV is marked on nodes
//! and relations and is known one frame ahead if the protocol shows it; motion enters as continuous
//! features, not as a token; light states enter with the relation to the places that they control.

pub(crate) mod batch;
pub(crate) mod body;
mod choice;
mod config;
mod error;
mod lane_graph;
mod observe;
pub(crate) mod corridor;
pub(crate) mod known_map;
pub(crate) mod lane;
pub(crate) mod links;
pub(crate) mod network;
mod pair;
mod place;
pub(crate) mod places;
mod policy;
mod scoring;
mod simulator;
mod widths;
pub(crate) mod step;
mod window;

pub use config::Config;
pub use error::PolicyError;
pub use network::Network;
pub use policy::Policy;
pub use scoring::{Known, Logits};
pub use simulator::ReactiveSimulator;
pub(crate) use widths::BODY_FEATURES;
