//! Next-token prediction: agents move by tokens of half a second, drawn from the distribution that a
//! network predicts.

pub(super) mod entries;
mod clearance;
pub(crate) mod drive;
mod execute;
pub mod learn;
pub mod reactive;
mod policy_loss;
mod sampling;
pub mod smart;
mod smoothing;
mod token_loss;
mod token_replay;
pub mod tokens;

pub use sampling::{Driving, Sampling};
pub use token_replay::{TokenReplay, TokenReplayParameters};
