//! Feed-forward half of an attention layer.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use burn::tensor::activation::silu;
use serde::{Deserialize, Serialize};

use super::{Initializer, Noise, Rows, linear};

/// Type and width of a feed-forward network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeedForwardConfig {
    /// Linear to this hidden width, ReLU, linear (SMART, CATK: four times the width of the layer).
    Relu(usize),
    /// SwiGLU with this hidden width (TrajTok: see [`FeedForwardConfig::swiglu`]).
    SwiGlu(usize),
}

impl FeedForwardConfig {
    /// Returns a SwiGLU network with about as many weights as a ReLU network of width `hidden`: two
    /// thirds of that width, rounded up to a multiple of 8.
    pub fn swiglu(hidden: usize) -> Self {
        Self::SwiGlu((hidden * 2 / 3).next_multiple_of(8))
    }

    /// Builds the network for features of this width.
    pub fn init(self, width: usize, init: &mut Initializer) -> FeedForward {
        match self {
            Self::Relu(hidden) => FeedForward::Relu(ReluLayers {
                wide: init.linear(width, hidden, true),
                narrow: init.linear(hidden, width, true),
            }),
            Self::SwiGlu(hidden) => FeedForward::SwiGlu(SwiGluLayers {
                wide: init.linear(width, 2 * hidden, true),
                narrow: init.linear(hidden, width, true),
            }),
        }
    }
}

/// A feed-forward network.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant, reason = "both hold two linear layers")]
pub enum FeedForward {
    /// Linear, ReLU, dropout, linear.
    Relu(ReluLayers),
    /// Gate times value, then linear; no dropout, as published.
    SwiGlu(SwiGluLayers),
}

/// The layers of [`FeedForward::Relu`].
#[derive(Module, Debug)]
pub struct ReluLayers {
    wide: Linear,
    narrow: Linear,
}

/// The layers of [`FeedForward::SwiGlu`]: the first half of the wide layer is the gate.
#[derive(Module, Debug)]
pub struct SwiGluLayers {
    wide: Linear,
    narrow: Linear,
}

impl FeedForward {
    /// Maps [N, width] to [N, width].
    pub fn forward(&self, x: Tensor<2>, dropout: f64, noise: &mut Noise) -> Tensor<2> {
        match self {
            Self::Relu(layers) => {
                let hidden = Rows::linear(&layers.wide, x).relu().done();
                linear(&layers.narrow, noise.drop(hidden, dropout))
            }
            Self::SwiGlu(layers) => {
                let both = linear(&layers.wide, x);
                let hidden = both.dims()[1] / 2;
                let (gate, value) = (both.clone().narrow(1, 0, hidden), both.narrow(1, hidden, hidden));
                linear(&layers.narrow, silu(gate) * value)
            }
        }
    }
}
