//! What networks that learn from scenarios have in common: scenes and their variants, samples of bounded size.

mod sample;
mod scene;

pub(crate) use sample::Sample;
pub(crate) use scene::{LearningMap, LearningScene};
