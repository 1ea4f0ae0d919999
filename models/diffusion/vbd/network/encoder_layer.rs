//! A layer of the scene encoder: attention among all elements with their relations.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Perceptron, Rows, dense_attention, linear};

use super::perceptrons::GELU;
use super::surroundings::Surroundings;

/// Attention whose keys and values are those of elements plus their relation to the query's element.
#[derive(Module, Debug)]
pub(super) struct RelatedAttention {
    in_proj: Linear,
    out_proj: Linear,
    heads: usize,
}

impl RelatedAttention {
    /// Returns what the first elements of `[n, width]` take from those that they see, `[own, width]`.
    fn forward(&self, x: Tensor<2>, seen: &Surroundings, closed: Tensor<4>) -> Tensor<2> {
        let [count, width] = x.dims();
        let [own, each, _] = seen.relations.dims();
        let depth = width / self.heads;
        // Queries, keys and values lie side by side within each head.
        let all = linear(&self.in_proj, x).reshape([count, self.heads, 3, depth]);
        let part = |k: usize| all.clone().narrow(2, k, 1).reshape([count, width]);
        let with_relations =
            |x: Tensor<2>| (seen.relations.clone() + seen.features(x)).reshape([own * each, width]);
        // Every element has keys and values of its own.
        let products = vec![(part(0).narrow(0, 0, own), with_relations(part(1)))];
        let taken = dense_attention(own, self.heads, products, with_relations(part(2)), closed);
        linear(&self.out_proj, taken)
    }
}

/// Attention and a feed-forward network, each followed by a norm.
#[derive(Module, Debug)]
pub(super) struct EncoderLayer {
    qc_attention: RelatedAttention,
    ffn: Perceptron,
    norm_1: LayerNorm,
    norm_2: LayerNorm,
}

impl EncoderLayer {
    pub(super) fn init(width: usize, heads: usize, init: &mut Initializer) -> Self {
        Self {
            qc_attention: RelatedAttention {
                in_proj: init.linear(width, 3 * width, true),
                out_proj: init.linear(width, width, true),
                heads,
            },
            ffn: GELU.init(&[width, 4 * width, width], init),
            norm_1: init.norm(width),
            norm_2: init.norm(width),
        }
    }

    /// Maps elements `[n, width]`. The first m of them attend, each to the k that it sees; others stay as
    /// they are. `closed`, `[m or 1, 1, 1, k or 1]`, is added to scores.
    pub(super) fn forward(&self, x: Tensor<2>, seen: &Surroundings, closed: Tensor<4>) -> Tensor<2> {
        let taken = self.qc_attention.forward(x.clone(), seen, closed);
        let (all, own) = (x.dims()[0], taken.dims()[0]);
        let first = Rows::of(x.clone().narrow(0, 0, own) + taken).norm(&self.norm_1).done();
        let first = Rows::of(first.clone() + self.ffn.forward(first)).norm(&self.norm_2).done();
        if own == all { first } else { Tensor::cat(vec![first, x.narrow(0, own, all - own)], 0) }
    }
}
