//! Multi-head attention with one matrix for queries, keys and values, as in PyTorch.

use std::ops::{Range, RangeInclusive};

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

/// Returns the columns of consecutive parts.
const fn columns(parts: &RangeInclusive<Part>, width: usize) -> Range<usize> {
    *parts.start() as usize * width..(*parts.end() as usize + 1) * width
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

    /// Multiplies rows `[n, width]` with the matrices of consecutive parts, without their biases.
    fn product(&self, parts: RangeInclusive<Part>, x: Tensor<2>) -> Rows {
        let width = x.dims()[1];
        let weight = self.in_proj_weight.val().transpose();
        Rows::product(x, weight.slice([0..width, columns(&parts, width)]))
    }

    /// Projects rows `[n, width]` to consecutive parts at once, `[n, parts * width]`.
    pub fn parts(&self, parts: RangeInclusive<Part>, x: Tensor<2>) -> Tensor<2> {
        let columns = columns(&parts, x.dims()[1]);
        let bias = self.in_proj_bias.val().unsqueeze_dim::<2>(0).slice([0..1, columns]);
        self.product(parts, x).plus(bias).done()
    }

    /// Projects rows `[n, width]` to a part.
    pub fn part(&self, part: Part, x: Tensor<2>) -> Tensor<2> {
        self.parts(part..=part, x)
    }

    /// Projects rows `[n, width]` to a part, without its bias: what a summand contributes to the part of a
    /// sum.
    pub fn summand(&self, part: Part, x: Tensor<2>) -> Tensor<2> {
        self.product(part..=part, x).done()
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
