//! Layers and tools that several networks share: devices, weights files and building blocks.
//!
//! Everything here is a function of its inputs. Initial weights come from a seed ([`Initializer`])
//! and dropout from a stream of the caller ([`Noise`]); no layer reads the time or draws its own
//! random numbers.

mod attention;
mod dense_attention;
mod device;
mod feed_forward;
mod fourier;
#[cfg(feature = "flex")]
mod fused;
#[cfg(test)]
pub(crate) mod golden;
mod host;
mod initializer;
mod mlp;
mod multi_head;
mod neighbors;
mod noise;
mod processor;
mod relations;
mod rows;
mod shared_rows;
mod size_error;
mod turns;
pub mod weights;

pub use attention::{AttentionConfig, RelationalAttention};
pub(crate) use dense_attention::{CLOSED, dense_attention};
pub use device::{Backend, BackendError, device};
pub use feed_forward::{FeedForward, FeedForwardConfig, ReluLayers, SwiGluLayers};
pub use fourier::{FourierEmbedding, ScalarLayers};
pub(crate) use host::is_host;
pub use initializer::Initializer;
pub use mlp::{MlpEmbedding, MlpLayer, PlainMlp};
pub(crate) use multi_head::{MultiHeadAttention, Part};
pub use neighbors::Neighbors;
pub use noise::Noise;
pub use processor::cpu_class;
pub use relations::Relations;
pub use rows::normalize;
pub(crate) use rows::{Rows, gelu, linear, pool};
pub(crate) use shared_rows::{RowCollector, SharedRows};
pub use size_error::SizeError;
pub(crate) use turns::cos_sin_rows;
pub use weights::{Tensors, WeightsError, save};
