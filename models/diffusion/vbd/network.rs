//! The network.
//!
//! Tensors have the names and shapes of the public code, so that its state dict loads. A scene is computed at
//! a time: its elements are the agents, then the map lines, then the lights. [`SceneInput`] describes them in
//! the frame of the map; the network sees each in its own frame, and the relations of all pairs.

mod config;
mod cross_block;
mod denoiser;
mod encoder_layer;
#[cfg(test)]
mod golden;
mod input;
mod pairs;
mod perceptrons;
mod predictor;
mod scene_encoder;
mod surroundings;
mod vbd;

pub use config::VbdConfig;
pub use denoiser::DenoisingScene;
pub use input::{Line, SceneInput};
pub use predictor::Behaviours;
pub use scene_encoder::Encoded;
pub use vbd::Vbd;
