//! The published next-token network (SMART, CATK and the TrajTok variant); exported weights run
//! unchanged.
//!
//! Read [`Scene`] first (input), then [`Smart`] (output: a score for every token of every agent), then
//! [`CachedScene`] (step-by-step evaluation with cached steps). [`Edges`] defines which pairs attend and
//! their relation scalars. [`SmartSimulator`] is the simulator; a [`SmartPolicy`] is the network with
//! its vocabularies in one file, and `README.md` describes how to make that file.
//!
//! Sources: SMART (Wu et al., NeurIPS 2024, github.com/rainmaker22/SMART), CATK (Zhang et al., CVPR
//! 2025, github.com/NVlabs/catk), TrajTok (arXiv 2506.21618, github.com/Thinklab-SJTU/TrajTok).

mod agent_encoder;
mod batch;
mod config;
mod edges;
mod cached_scene;
mod head;
pub mod learn;
mod links;
mod lockstep;
mod map_encoder;
mod network;
mod observed;
mod pending;
mod policy;
mod relation;
mod scene;
mod simulator;
mod stage;
mod tables;
mod token_shapes;

pub use agent_encoder::AgentEncoder;
pub use batch::Batch;
pub use cached_scene::{CachedScene, EncodedMap};
pub use config::{FeedForwardKind, SmartConfig, TokenCounts};
pub use edges::Edges;
pub use head::{ClassHeads, TokenHead};
pub use links::Links;
pub use map_encoder::MapEncoder;
pub use network::Smart;
pub use policy::SmartPolicy;
use policy::token_shapes;
pub use relation::{bearing, wrap};
pub use scene::{Agents, InputError, MapTokens, Scene, Step};
pub use simulator::{SmartParameters, SmartSimulator};
pub use stage::Stage;
pub use tables::TokenTables;
pub use token_shapes::TokenShapes;
