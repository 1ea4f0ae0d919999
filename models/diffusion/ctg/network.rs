//! The network of CTG: a convolutional encoder of images, and either a head for controls (behaviour cloning)
//! or a denoiser of actions.

mod config;
mod convolution;
mod ctg;
mod denoiser;
mod motion;
mod raster_encoder;

pub use config::{CtgConfig, Decoding};
pub(crate) use ctg::ATTRIBUTES;
pub use ctg::{Ctg, EncodedAgents};
pub(crate) use motion::{NUMBERS, normalized_state, trajectory, unnormalized_states};
