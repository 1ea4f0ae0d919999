//! How the network learns: samples from logged scenes, the loss, what is measured.

mod disturb;
mod loss;
mod measure;
mod sample;
mod task;

pub use disturb::Disturbance;
pub use measure::MEASURES;
pub use sample::{Augmentation, Sample};
pub use task::{FromError, Recipe, Regression};
