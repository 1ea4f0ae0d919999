//! Attention among all elements.

use burn::module::Module;
use burn::nn::LayerNorm;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, MultiHeadAttention, Part, Perceptron, Rows};

use super::PlannerConfig;
use super::perceptron::GELU;

/// A layer. Keys and values are not normalised, as in the public code.
#[derive(Module, Debug)]
struct FusionBlock {
    norm1: LayerNorm,
    attn: MultiHeadAttention,
    norm2: LayerNorm,
    mlp: Perceptron,
}

/// Layers and a norm.
#[derive(Module, Debug)]
pub(super) struct Fusion {
    blocks: Vec<FusionBlock>,
    norm: LayerNorm,
}

impl Fusion {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        let d = config.width;
        let block = |_| FusionBlock {
            norm1: init.norm(d),
            attn: MultiHeadAttention::init(d, config.heads, init),
            norm2: init.norm(d),
            mlp: GELU.init(&[d, 4 * d, d], init),
        };
        let blocks = (0..config.encoder_depth).map(block).collect();
        Self { blocks, norm: init.norm(d) }
    }

    /// Maps elements `[n, width]`; `closed`, `[1, 1, 1, n]`, is added to the scores of keys.
    pub(super) fn forward(&self, mut x: Tensor<2>, closed: &Tensor<4>) -> Tensor<2> {
        for FusionBlock { norm1, attn, norm2, mlp } in &self.blocks {
            let queries = attn.part(Part::Query, Rows::of(x.clone()).norm(norm1).done());
            let (keys, values) = (attn.part(Part::Key, x.clone()), attn.part(Part::Value, x.clone()));
            x = x + attn.output(attn.take(1, queries, keys, values, closed.clone())).done();
            x = x.clone() + mlp.forward(Rows::of(x).norm(norm2).done());
        }
        Rows::of(x).norm(&self.norm).done()
    }
}
