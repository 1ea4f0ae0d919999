//! Two linear layers with an activation between them.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use burn::tensor::activation::gelu_approximate;
use reactsim_nn::{Initializer, gelu, linear};

/// Linear, GELU, linear.
#[derive(Module, Debug)]
pub(super) struct Perceptron {
    fc1: Linear,
    fc2: Linear,
}

impl Perceptron {
    pub(super) fn init([inputs, hidden, outputs]: [usize; 3], init: &mut Initializer) -> Self {
        Self { fc1: init.linear(inputs, hidden, true), fc2: init.linear(hidden, outputs, true) }
    }

    /// Maps `[n, inputs]` to `[n, outputs]`.
    pub(super) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        linear(&self.fc2, gelu(linear(&self.fc1, x)))
    }

    /// The same with the approximate GELU.
    pub(super) fn forward_tanh(&self, x: Tensor<2>) -> Tensor<2> {
        linear(&self.fc2, gelu_approximate(linear(&self.fc1, x)))
    }

    /// Maps the middle axis of `[n, inputs, width]`: `[n, outputs, width]`.
    pub(super) fn forward_middle(&self, x: Tensor<3>) -> Tensor<3> {
        let [n, inputs, width] = x.dims();
        let y = self.forward(x.swap_dims(1, 2).reshape([n * width, inputs]));
        let outputs = y.dims()[1];
        y.reshape([n, width, outputs]).swap_dims(1, 2)
    }
}
