//! Small perceptrons: the two of the SMART family (SMART, CATK, TrajTok), and one without norms.

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

/// Two or three linear layers with biases, with ReLU between them.
#[derive(Module, Debug)]
pub struct PlainMlp {
    first: Linear,
    second: Linear,
    third: Option<Linear>,
}

impl PlainMlp {
    /// Creates two layers.
    pub fn two(inputs: usize, widths: [usize; 2], init: &mut Initializer) -> Self {
        let first = init.linear(inputs, widths[0], true);
        Self { first, second: init.linear(widths[0], widths[1], true), third: None }
    }

    /// Creates three layers.
    pub fn three(inputs: usize, widths: [usize; 3], init: &mut Initializer) -> Self {
        let two = Self::two(inputs, [widths[0], widths[1]], init);
        Self { third: Some(init.linear(widths[1], widths[2], true)), ..two }
    }

    /// Maps `[n, inputs]` to `[n, last width]`.
    pub fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let x = Rows::linear(&self.second, Rows::linear(&self.first, x).relu().done());
        match &self.third {
            Some(third) => Rows::linear(third, x.relu().done()).done(),
            None => x.done(),
        }
    }
}
