//! Layers and tools that several networks share: devices, weights files and building blocks; what agents
//! perceive ([`perception`]), scenes and tasks of training ([`learning`]), and the learning loop
//! ([`training`]).
//!
//! Layers are functions of their inputs. Initial weights come from a seed ([`Initializer`])
//! and dropout from a stream of the caller ([`Noise`]); no layer reads the time or draws its own
//! random numbers.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod attention;
mod dense_attention;
mod device;
mod feed_forward;
mod fourier;
mod fused;
mod host;
mod initializer;
pub mod learning;
mod links;
mod multi_head;
mod neighbors;
mod noise;
pub mod perception;
mod perceptron;
mod processor;
mod relations;
mod rows;
mod shared_rows;
mod size_error;
pub mod training;
mod turns;
pub mod weights;

pub use attention::{AttentionConfig, RelationalAttention};
pub use dense_attention::{CLOSED, dense_attention};
pub use device::{check_backend, device, device_of};
pub use feed_forward::FeedForwardConfig;
pub use fourier::FourierEmbedding;
pub use host::is_host;
pub use initializer::Initializer;
pub use links::{LinkTensors, Links};
pub use multi_head::{MultiHeadAttention, Part};
pub use neighbors::Neighbors;
pub use noise::Noise;
pub use perceptron::{Activation, Perceptron, PerceptronKind};
pub use processor::cpu_class;
pub use relations::Relations;
pub use rows::{Rows, gather, gelu, indices, largest, linear, mish, normalize, pool};
pub use shared_rows::{RowCollector, SharedRows};
pub use size_error::SizeError;
pub use turns::cos_sin_rows;
pub use weights::{Tensors, WeightsError, save};

pub use reactsim_baseline::{Backend, BackendError};
