//! MLP-Mixers.

use burn::module::Module;
use burn::nn::LayerNorm;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Perceptron, Rows};

use super::perceptron::{GELU, map_middle};

/// Mixes tokens, then channels, each with a residual.
#[derive(Module, Debug)]
pub(super) struct Mixer {
    norm1: LayerNorm,
    tokens_mlp: Perceptron,
    norm2: LayerNorm,
    channels_mlp: Perceptron,
}

impl Mixer {
    pub(super) fn init(tokens: usize, channels: usize, init: &mut Initializer) -> Self {
        Self {
            norm1: init.norm(channels),
            tokens_mlp: GELU.init(&[tokens; 3], init),
            norm2: init.norm(channels),
            channels_mlp: GELU.init(&[channels; 3], init),
        }
    }

    /// Maps `[n, tokens, channels]`.
    pub(super) fn forward(&self, x: Tensor<3>) -> Tensor<3> {
        let [n, tokens, channels] = x.dims();
        let x = x.clone() + map_middle(&self.tokens_mlp, normed(&self.norm1, x));
        let rows = normed(&self.norm2, x.clone()).reshape([n * tokens, channels]);
        x + self.channels_mlp.forward(rows).reshape([n, tokens, channels])
    }
}

/// Applies a layer norm to the last axis.
pub(super) fn normed(norm: &LayerNorm, x: Tensor<3>) -> Tensor<3> {
    let [n, tokens, channels] = x.dims();
    Rows::of(x.reshape([n * tokens, channels])).norm(norm).done().reshape([n, tokens, channels])
}
