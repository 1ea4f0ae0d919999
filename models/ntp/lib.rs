//! Next-token prediction: agents move by tokens of half a second, drawn from the distribution that a
//! network predicts.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod beginnings;
mod clearance;
pub(crate) mod drive;
pub mod entries;
mod execute;
pub mod guarded;
mod haste;
pub mod learn;
mod policy_loss;
pub mod reactive;
pub mod realism;
mod sampling;
pub mod smart;
mod slowdown;
mod smoothing;
mod token_loss;
pub mod tokens;

pub use sampling::{Driving, Sampling};
