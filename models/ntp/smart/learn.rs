//! Training of the network on scenarios: recipe, samples, loss.

pub mod catk;
mod closed_loop;
mod driven;
mod fine_tuning;
pub mod grpo;
mod recipe;
mod sample;
mod task;
mod token_learning;
mod tracked;

pub use closed_loop::{ClosedLoopSample, Excerpt};
pub(crate) use driven::DrivenSmart;
pub use recipe::{Augmentation, NetworkSizes, Recipe};
pub use sample::Sample;
pub use task::{NextSmartToken, TASK};
