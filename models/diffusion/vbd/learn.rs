//! Training of the network on scenarios: recipe, samples, loss.

mod loss;
mod recipe;
mod sample;
mod task;

pub use recipe::Recipe;
pub use sample::Sample;
pub use task::{Denoising, TASK};
