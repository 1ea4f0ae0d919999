//! Next-token prediction: agents move by tokens of half a second, drawn from what a network thinks probable.

pub(super) mod entries;
mod clearance;
mod execute;
pub mod learn;
pub mod reactive;
mod sampling;
pub mod smart;
pub mod tokens;

pub use sampling::{Driving, Sampling};
