//! Layers and tools that several networks share: where they run, how their weights are read, what they are built of.
//!
//! Everything here is a function of its inputs: initial weights come from a seed ([`Initializer`]), dropout from a stream that the
//! caller names ([`Noise`]), and no layer asks for the time or draws numbers of its own.

mod attention;
mod device;
mod feed_forward;
mod fourier;
mod initializer;
mod mlp;
mod neighbors;
mod noise;
mod processor;
mod relations;
mod turns;
pub mod weights;

pub use attention::{AttentionConfig, RelationalAttention, normalize};
pub use device::{backend, device};
pub use feed_forward::{FeedForward, FeedForwardConfig, ReluLayers, SwiGluLayers};
pub use fourier::{FourierEmbedding, ScalarLayers};
pub use initializer::Initializer;
pub use mlp::{MlpEmbedding, MlpLayer};
pub use neighbors::Neighbors;
pub use noise::Noise;
pub use processor::cpu_class;
pub use relations::Relations;
pub use weights::{Tensors, WeightsError, save};
