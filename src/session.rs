//! The program as a process that answers requests of the Python package: scores of rollouts in memory, and
//! environments for reinforcement learning whose traffic is simulated as in runs.
//!
//! Start with [`serve`], which answers the requests of the parent process until its stream ends, and with
//! [`Environment`], whose actions drive the AV, or with [`World`], whose actions move agents. Requests and
//! answers are frames of the protocol for external simulators ([`crate::external::Frame`]) with arguments in
//! JSON. They are an interface between this program and its Python package of the same version.
//!
//! A file uses only files above it in this list: `wire` and `arrays`; `action`, `scenarios` and `traffic`;
//! `environment`, `world`, `scores` and `realism`; `requests`; `server`.

mod action;
mod arrays;
mod environment;
mod realism;
mod requests;
mod scenarios;
mod scores;
mod server;
mod traffic;
mod wire;
mod world;

pub use action::ActionKind;
pub use arrays::{Arrays, Sizes};
pub use environment::{
    End, EndCondition, Environment, EnvironmentSettings, EpisodeBeginning, MEASURES, Stepped,
};
pub use server::serve;
pub use traffic::Traffic;
pub use wire::RequestError;
pub use world::{AGENT_MEASURES, World, WorldSettings, WorldStepped};
