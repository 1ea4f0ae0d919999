//! Multi-head attention with one matrix for queries, keys and values, as in PyTorch.

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::Tensor;

use super::{Initializer, Rows, dense_attention, linear};

/// Multi-head attention.
#[derive(Module, Debug)]
pub(crate) struct MultiHeadAttention {
    /// `[3 width, width]`: queries, keys, values.
    in_proj_weight: Param<Tensor<2>>,
    in_proj_bias: Param<Tensor<1>>,
    out_proj: Linear,
    heads: usize,
}

/// What an input of an attention becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Query,
    Key,
    Value,
}

impl MultiHeadAttention {
    /// Creates the layers.
    pub(crate) fn init(width: usize, heads: usize, init: &mut Initializer) -> Self {
        // Glorot bound of the whole matrix, as in PyTorch.
        let bound = (6.0 / (4 * width) as f64).sqrt();
        Self {
            in_proj_weight: init.uniform([3 * width, width], bound),
            in_proj_bias: init.uniform([3 * width], 0.0),
            out_proj: init.linear(width, width, true),
            heads,
        }
    }

    /// Multiplies rows `[n, width]` with a part of the matrix, without the bias.
    pub(crate) fn product(&self, part: Part, x: Tensor<2>) -> Rows {
        let width = x.dims()[1];
        let weight = self.in_proj_weight.val().transpose();
        let from = part as usize * width;
        Rows::product(x, weight.slice([0..width, from..from + width]))
    }

    /// Returns the bias of a part, `[1, width]`.
    pub(crate) fn bias(&self, part: Part) -> Tensor<2> {
        let bias = self.in_proj_bias.val();
        let width = bias.dims()[0] / 3;
        let from = part as usize * width;
        bias.narrow(0, from, width).unsqueeze_dim(0)
    }

    /// Projects rows `[n, width]` to a part.
    pub(crate) fn part(&self, part: Part, x: Tensor<2>) -> Tensor<2> {
        self.product(part, x).plus(self.bias(part)).done()
    }

    /// Attends with parts that are projected already: as [`dense_attention`], then the output layer.
    pub(crate) fn attend(
        &self,
        scenes: usize,
        queries: Tensor<2>,
        keys: Tensor<2>,
        values: Tensor<2>,
        closed: Tensor<4>,
    ) -> Tensor<2> {
        let taken = dense_attention(scenes, self.heads, vec![(queries, keys)], values, closed);
        linear(&self.out_proj, taken)
    }
}
