//! Training of the network: samples from logged scenes, and the loss.

mod driven;
mod task;

pub(crate) use driven::DrivenReactive;
pub use task::{NextToken, Recipe, TASK};

pub(crate) mod loss;
pub(crate) mod sample;
