//! Training of the network: samples from logged scenarios, the loss, and accuracy measures.

mod disturb;
mod loss;
mod measure;
mod sample;
mod task;

pub use disturb::Disturbance;
pub use measure::MEASURES;
pub use sample::{Augmentation, Sample};
pub use task::{Recipe, Regression, TASK};
