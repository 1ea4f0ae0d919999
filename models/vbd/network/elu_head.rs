//! Heads with ELU.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use burn::tensor::activation::elu;
use reactsim_nn::{Initializer, linear};

/// Linear, ELU, linear.
#[derive(Module, Debug)]
pub(super) struct EluHead {
    first: Linear,
    second: Linear,
}

impl EluHead {
    pub(super) fn init(inputs: usize, hidden: usize, outputs: usize, init: &mut Initializer) -> Self {
        Self { first: init.linear(inputs, hidden, true), second: init.linear(hidden, outputs, true) }
    }

    /// Maps `[n, inputs]` to `[n, outputs]`.
    pub(super) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        linear(&self.second, elu(linear(&self.first, x), 1.0))
    }
}
