//! A block of predictor and denoiser: queries of an agent attend to sources as it sees them.

use burn::module::Module;
use burn::nn::LayerNorm;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, MultiHeadAttention, Part, Perceptron, Rows};

use super::perceptrons::GELU;
use super::surroundings::Surroundings;

/// Keys and values of one block.
#[derive(Clone, Debug)]
pub(super) struct KeysValues<const D: usize> {
    keys: Tensor<D>,
    values: Tensor<D>,
}

/// Attention and a feed-forward network, each followed by a norm. As published, what attention takes replaces
/// the queries; with a residual it is added to them.
///
/// An agent sees a source as the features of it, the same for all agents, plus its relation to it.
#[derive(Module, Debug)]
pub(super) struct CrossBlock {
    cross_attention: MultiHeadAttention,
    ffn: Perceptron,
    norm_1: LayerNorm,
    norm_2: LayerNorm,
}

impl CrossBlock {
    pub(super) fn init(width: usize, heads: usize, init: &mut Initializer) -> Self {
        Self {
            cross_attention: MultiHeadAttention::init(width, heads, init),
            ffn: GELU.init(&[width, 4 * width, width], init),
            norm_1: init.norm(width),
            norm_2: init.norm(width),
        }
    }

    /// Projects the relations of agents to those that they see. The product of a sum is the sum
    /// of the products, so that relations, which stay, are multiplied once for all features that come with
    /// them.
    pub(super) fn relate(&self, seen: &Surroundings) -> KeysValues<3> {
        let [agents, others, width] = seen.relations.dims();
        let rows = seen.relations.clone().reshape([agents * others, width]);
        let project =
            |part| self.cross_attention.summand(part, rows.clone()).reshape([agents, others, width]);
        KeysValues { keys: project(Part::Key), values: project(Part::Value) }
    }

    /// Adds the features of sources, `[elements * each, width]`, to relations; the `each` sources of an
    /// element share one.
    pub(super) fn sources(
        &self,
        seen: &Surroundings,
        related: &KeysValues<3>,
        features: &Tensor<2>,
        each: usize,
    ) -> KeysValues<2> {
        let [agents, others, width] = related.keys.dims();
        let elements = features.dims()[0] / each;
        let add = |part, relations: &Tensor<3>| {
            let features = self.cross_attention.part(part, features.clone());
            let features = seen.features(features.reshape([elements, each * width]));
            let alike = features.dims()[0];
            let features = features.reshape([alike, others, each, width]);
            let relations = relations.clone().reshape([agents, others, 1, width]);
            (relations + features).reshape([agents * others * each, width])
        };
        KeysValues { keys: add(Part::Key, &related.keys), values: add(Part::Value, &related.values) }
    }

    /// Maps queries `[agents * queries, width]`; `closed`, `[agents or 1, 1, queries or 1, sources]`, is
    /// added to scores.
    pub(super) fn forward(
        &self,
        agents: usize,
        queries: Tensor<2>,
        sources: KeysValues<2>,
        closed: &Tensor<4>,
        residual: bool,
    ) -> Tensor<2> {
        let attention = &self.cross_attention;
        let KeysValues { keys, values } = sources;
        let asked = attention.part(Part::Query, queries.clone());
        let taken = attention.output(attention.take(agents, asked, keys, values, closed.clone()));
        let taken = if residual { taken.plus(queries) } else { taken };
        let y = taken.norm(&self.norm_1).done();
        Rows::of(y.clone() + self.ffn.forward(y)).norm(&self.norm_2).done()
    }
}
