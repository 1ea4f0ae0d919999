//! The network of MTR (Shi et al., "Motion Transformer with Global Intention Localization and Local
//! Movement Refinement", <https://arxiv.org/abs/2209.13508>), for processor cores.
//!
//! One implementation serves two configurations. [`Config::mtr`] has the sizes, the inputs and the
//! tensors of the public code (<https://github.com/sshaoshuai/MTR>, Apache-2.0), so that a state dict
//! exported from it loads. [`Config::default`] is small and is trained here. All coordinates are in the
//! frame of the predicted agent: x along its heading, y to its left.

mod batch;
mod collect;
mod config;
mod decoder;
mod decoder_layer;
mod dense;
mod encoder;
#[cfg(test)]
mod golden;
mod guide;
mod layers;
mod motion_transformer;
mod output;
mod polyline_encoder;
mod sine;
mod suppress;

pub use config::{Attributes, Config, Norms};
pub use motion_transformer::Network;
pub use suppress::suppress;

pub(crate) use batch::Batch;
pub(crate) use output::LayerOutput;

/// Number of values per predicted state: x, y (metres), the logarithms of two deviations, correlation,
/// velocity x, y (m/s).
pub const STATE: usize = 7;
