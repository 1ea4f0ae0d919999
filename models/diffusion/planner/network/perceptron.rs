//! Perceptrons of the planner.

use burn::tensor::Tensor;
use reactsim_nn::{Activation, Perceptron, PerceptronKind};

/// Linear, GELU, linear, named as in the library timm.
pub(super) const GELU: PerceptronKind =
    PerceptronKind { activation: Activation::Gelu, linears: &["fc1", "fc2"], norms: &[] };
/// The same with the approximate GELU.
pub(super) const GELU_TANH: PerceptronKind = PerceptronKind { activation: Activation::GeluTanh, ..GELU };

/// Maps the middle axis of `[n, inputs, width]`: `[n, outputs, width]`.
pub(super) fn map_middle(perceptron: &Perceptron, x: Tensor<3>) -> Tensor<3> {
    let [n, inputs, width] = x.dims();
    let y = perceptron.forward(x.swap_dims(1, 2).reshape([n * width, inputs]));
    let outputs = y.dims()[1];
    y.reshape([n, width, outputs]).swap_dims(1, 2)
}
