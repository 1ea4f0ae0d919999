//! Fine-tuning by realism: the network drives every scenario several times, as a simulator, and what made the
//! rollouts more realistic becomes likelier.
//!
//! The Sim Agents metametric judges all rollouts of a scenario together. An agent's advantage in a rollout is
//! its leave-one-out share, the metametric of all rollouts minus that without its motion in this one, less
//! the mean share in the other rollouts. With an AV that leaves its log, the advantage is the fine for
//! contacts and for over-reaction, less that in the other rollouts (as in
//! [`grpo`](super::smart::learn::grpo)). The divergence from the network that the training began with is
//! fined, so that what is not rewarded stays as it was.
//!
//! Rollouts are those of the simulator. The reactive network learns from the tokens that it drew there,
//! [`smart`](super::smart) from the ones nearest to what agents did.

mod advantage;
mod driven;
mod group;
mod recipe;
mod task;

pub(crate) use driven::Driven;
pub(crate) use group::Group;
pub use recipe::{Features, RealismRecipe, Weights};
pub use task::{TASK, realism};
