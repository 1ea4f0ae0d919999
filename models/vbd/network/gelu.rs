//! Feed-forward networks with GELU.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, gelu, linear};

/// Linear, GELU, linear; four times as wide between.
#[derive(Module, Debug)]
pub(super) struct GeluLayers {
    wide: Linear,
    narrow: Linear,
}

impl GeluLayers {
    pub(super) fn init(width: usize, init: &mut Initializer) -> Self {
        Self { wide: init.linear(width, 4 * width, true), narrow: init.linear(4 * width, width, true) }
    }

    /// Maps `[n, width]` to `[n, width]`.
    pub(super) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        linear(&self.narrow, gelu(linear(&self.wide, x)))
    }
}
