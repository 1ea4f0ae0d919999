//! The program as a process that answers requests of the Python package: scores of rollouts in memory, and
//! environments for reinforcement learning whose traffic is simulated as in runs.
//!
//! Start with [`serve`], which answers requests over two streams until the first one ends, and with
//! [`Environment`], whose actions drive the AV, or with [`World`], whose actions move the agents. Requests
//! and answers are frames of the protocol for external simulators ([`crate::external::Frame`]) with
//! arguments in JSON. They are an interface between this program and its Python package of the same version.

mod action;
mod arrays;
mod drive;
mod realism;
mod requests;
mod scenarios;
mod scores;
mod session;
mod world;
mod world_requests;

pub use action::ActionKind;
pub use arrays::{Arrays, Sizes};
pub use drive::{End, EndCondition, Environment, EnvironmentSettings, EpisodeBeginning, MEASURES, Stepped};
pub use session::{RequestError, serve};
pub use world::{AGENT_MEASURES, World, WorldStepped};
