//! Multi-head attention with one matrix for queries, keys and values, as in PyTorch.

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::Tensor;

use super::{Initializer, Rows, dense_attention};

/// Multi-head attention.
#[derive(Module, Debug)]
pub struct MultiHeadAttention {
    /// `[3 width, width]`: queries, keys, values.
    in_proj_weight: Param<Tensor<2>>,
    in_proj_bias: Param<Tensor<1>>,
    out_proj: Linear,
    heads: usize,
}

/// Queries, keys or values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Queries.
    Query,
    /// Keys.
    Key,
    /// Values.
    Value,
}

impl MultiHeadAttention {
    /// Creates the layers.
    pub fn init(width: usize, heads: usize, init: &mut Initializer) -> Self {
        // Glorot bound of the whole matrix, as in PyTorch.
        let bound = (6.0 / (4 * width) as f64).sqrt();
        Self {
            in_proj_weight: init.uniform([3 * width, width], bound),
            in_proj_bias: init.uniform([3 * width], 0.0),
            out_proj: init.linear(width, width, true),
            heads,
        }
    }

    /// Projects rows `[n, width]` to a part.
    pub fn part(&self, part: Part, x: Tensor<2>) -> Tensor<2> {
        let width = x.dims()[1];
        let bias = self.in_proj_bias.val().narrow(0, part as usize * width, width);
        self.product(part, x).plus(bias.unsqueeze_dim::<2>(0)).done()
    }

    /// Projects rows `[n, width]` to a part, without its bias: what a summand contributes to the part of a
    /// sum.
    pub fn summand(&self, part: Part, x: Tensor<2>) -> Tensor<2> {
        self.product(part, x).done()
    }

    fn product(&self, part: Part, x: Tensor<2>) -> Rows {
        let width = x.dims()[1];
        Rows::product(x, self.in_proj_weight.val().narrow(0, part as usize * width, width).transpose())
    }

    /// Attends with parts that are projected already, as [`dense_attention`]: what queries take, before the
    /// output layer.
    pub fn take(
        &self,
        scenes: usize,
        queries: Tensor<2>,
        keys: Tensor<2>,
        values: Tensor<2>,
        closed: Tensor<4>,
    ) -> Tensor<2> {
        dense_attention(scenes, self.heads, vec![(queries, keys)], values, closed)
    }

    /// Applies the output layer to what queries took.
    pub fn output(&self, taken: Tensor<2>) -> Rows {
        Rows::linear(&self.out_proj, taken)
    }
}
