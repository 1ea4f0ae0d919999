//! The two small perceptrons of the SMART family (SMART, CATK, TrajTok).

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::Tensor;

use super::{Initializer, Rows, linear};

/// Linear, layer norm, ReLU, linear.
#[derive(Module, Debug)]
pub struct MlpLayer {
    hidden: Linear,
    hidden_norm: LayerNorm,
    output: Linear,
}

impl MlpLayer {
    /// Builds the layers with these widths of input, hidden layer and output.
    pub fn init(inputs: usize, hidden: usize, outputs: usize, init: &mut Initializer) -> Self {
        Self {
            hidden: init.linear(inputs, hidden, true),
            hidden_norm: init.norm(hidden),
            output: init.linear(hidden, outputs, true),
        }
    }

    /// Maps [n, inputs] to [n, outputs].
    pub fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        linear(&self.output, Rows::linear(&self.hidden, x).norm(&self.hidden_norm).relu().done())
    }
}

/// Linear, layer norm and ReLU twice, then linear. The first width is 128 in all published
/// networks, independent of the second.
#[derive(Module, Debug)]
pub struct MlpEmbedding {
    first: Linear,
    first_norm: LayerNorm,
    second: Linear,
    second_norm: LayerNorm,
    third: Linear,
}

impl MlpEmbedding {
    /// Builds the layers with these widths of input and first layer; second layer and output have
    /// width `outputs`.
    pub fn init(inputs: usize, first: usize, outputs: usize, init: &mut Initializer) -> Self {
        Self {
            first: init.linear(inputs, first, true),
            first_norm: init.norm(first),
            second: init.linear(first, outputs, true),
            second_norm: init.norm(outputs),
            third: init.linear(outputs, outputs, true),
        }
    }

    /// Maps [n, inputs] to [n, outputs].
    pub fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let x = Rows::linear(&self.first, x).norm(&self.first_norm).relu().done();
        let x = Rows::linear(&self.second, x).norm(&self.second_norm).relu().done();
        linear(&self.third, x)
    }
}
