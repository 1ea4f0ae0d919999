//! The reactive network: sized for processor cores, made to notice the AV.
//!
//! Differences from SMART: every agent attends to a fixed number of neighbours; relations are hand-made numbers that hold relative
//! velocity, closing speed, gaps and crossing times; the AV is marked on nodes and on relations and is known one step ahead where the
//! protocol shows it; motion enters as it is, not as a token; lights enter with the relation to the places they control.

pub(crate) mod batch;
pub(crate) mod body;
mod choice;
mod config;
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
pub(crate) mod step;
mod window;

pub use config::Config;
pub use network::Network;
pub use policy::{Policy, PolicyError};
pub use scoring::{Known, Logits};
pub use simulator::ReactiveSimulator;
