//! A block of predictor and denoiser: queries of an agent attend to sources as it sees them.

use burn::module::Module;
use burn::nn::LayerNorm;
use burn::tensor::Tensor;

use super::gelu::GeluLayers;
use crate::models::nn::{Initializer, MultiHeadAttention, Part, Rows};

/// Sources of agents: features, the same for all, plus the relation to each.
pub(super) struct Sources {
    /// `[others * each, width]`.
    pub(super) features: Tensor<2>,
    /// `[agents, others, width]`; the `each` sources of another share a relation.
    pub(super) relations: Tensor<3>,
    /// Added to scores, `[agents or 1, 1, queries or 1, others * each]`.
    pub(super) closed: Tensor<4>,
}

/// Attention without a residual, as published, and a feed-forward network, each followed by a norm.
#[derive(Module, Debug)]
pub(super) struct CrossBlock {
    cross_attention: MultiHeadAttention,
    ffn: GeluLayers,
    norm_1: LayerNorm,
    norm_2: LayerNorm,
}

impl CrossBlock {
    pub(super) fn init(width: usize, heads: usize, init: &mut Initializer) -> Self {
        Self {
            cross_attention: MultiHeadAttention::init(width, heads, init),
            ffn: GeluLayers::init(width, init),
            norm_1: init.norm(width),
            norm_2: init.norm(width),
        }
    }

    fn attend(&self, queries: Tensor<2>, sources: &Sources) -> Tensor<2> {
        let [agents, others, width] = sources.relations.dims();
        let each = sources.features.dims()[0] / others;
        let attention = &self.cross_attention;
        // The product of a sum is the sum of the products: relations are multiplied once for all sources of another.
        let related = |part: Part| {
            let features = attention.part(part, sources.features.clone()).reshape([1, others, each, width]);
            let relations = sources.relations.clone().reshape([agents * others, width]);
            let relations = attention.product(part, relations).done().reshape([agents, others, 1, width]);
            (relations + features).reshape([agents * others * each, width])
        };
        let queries = attention.part(Part::Query, queries);
        attention.attend(agents, queries, related(Part::Key), related(Part::Value), sources.closed.clone())
    }

    /// Maps queries `[agents * queries, width]`.
    pub(super) fn forward(&self, queries: Tensor<2>, sources: &Sources) -> Tensor<2> {
        let taken = self.attend(queries, sources);
        let y = Rows::of(taken).norm(&self.norm_1).done();
        Rows::of(y.clone() + self.ffn.forward(y)).norm(&self.norm_2).done()
    }
}
