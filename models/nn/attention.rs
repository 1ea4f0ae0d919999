//! Gated attention over neighbours with a relation vector per pair: the basic block of the SMART
//! family.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::host::attend_to_neighbors;
use super::relations::RelationVectors;
use super::rows::gated;
use super::{FeedForwardConfig, Initializer, Neighbors, Noise, Perceptron, Relations, Rows, linear};

/// Largest ratio of sources to slots at which products are computed with all sources instead of
/// gathered ones.
const DENSE_SOURCES_PER_SLOT: usize = 3;

/// Dimensions and options of a [`RelationalAttention`] layer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttentionConfig {
    /// Feature width h.
    pub width: usize,
    /// Number of heads.
    pub heads: usize,
    /// Width of a head; heads × head_dim need not be the width.
    pub head_dim: usize,
    /// Width of relation vectors (SMART: the feature width).
    pub relation_width: usize,
    /// Feed-forward network.
    pub feed_forward: FeedForwardConfig,
    /// Whether sources and destinations have separate norms (SMART: map to agents) or share one.
    pub bipartite: bool,
    /// Whether relations go through a layer norm (SMART: yes). The caller normalizes them, once for
    /// all layers: see [`RelationalAttention::forward`].
    pub relation_norm: bool,
    /// Dropout rate of attention weights and hidden features in training.
    pub dropout: f64,
}

/// Attention of destinations to their neighbours. A relation vector is added to the key and value
/// of every pair; a gate mixes the message with the destination's own transform; a feed-forward
/// network follows. Both halves have norms before and after.
///
/// With k = Wk s + Wkr n and v = Wv s + Wvr n + b, a score is q·k = (Wkᵀq)·s + (Wkrᵀq)·n, and the
/// sum of weighted values is Wv Σws + Wvr Σwn + b Σw, so nothing is projected per pair. The gain of
/// the relation norm goes into Wkr and Wvr. Its bias is the same for all neighbours of a
/// destination: it cancels in the softmax and enters the values through Σw.
#[derive(Module, Debug)]
pub struct RelationalAttention {
    attn_prenorm_x_src: LayerNorm,
    attn_prenorm_x_dst: Option<LayerNorm>,
    attn_prenorm_r: Option<LayerNorm>,
    to_q: Linear,
    to_k: Linear,
    to_v: Linear,
    to_k_r: Linear,
    to_v_r: Linear,
    to_s: Linear,
    to_g: Linear,
    to_out: Linear,
    attn_postnorm: LayerNorm,
    ff_prenorm: LayerNorm,
    ff_mlp: Perceptron,
    ff_postnorm: LayerNorm,
    heads: usize,
    head_dim: usize,
    dropout: f64,
    /// Dropout rate of hidden features.
    hidden_dropout: f64,
}

impl AttentionConfig {
    /// Builds the layer with initial weights.
    pub fn init(&self, init: &mut Initializer) -> RelationalAttention {
        let (h, a, r) = (self.width, self.heads * self.head_dim, self.relation_width);
        RelationalAttention {
            attn_prenorm_x_src: init.norm(h),
            attn_prenorm_x_dst: self.bipartite.then(|| init.norm(h)),
            attn_prenorm_r: self.relation_norm.then(|| init.norm(r)),
            to_q: init.linear(h, a, true),
            to_k: init.linear(h, a, false),
            to_v: init.linear(h, a, true),
            to_k_r: init.linear(r, a, false),
            to_v_r: init.linear(r, a, true),
            to_s: init.linear(h, a, true),
            to_g: init.linear(a + h, a, true),
            to_out: init.linear(a, h, true),
            attn_postnorm: init.norm(h),
            ff_prenorm: init.norm(h),
            ff_mlp: self.feed_forward.init(h, init),
            ff_postnorm: init.norm(h),
            heads: self.heads,
            head_dim: self.head_dim,
            dropout: self.dropout,
            hidden_dropout: if self.feed_forward.has_dropout() { self.dropout } else { 0.0 },
        }
    }
}

impl RelationalAttention {
    /// Applies this layer's source norm to source features [M, h]. Constant sources (a map, earlier
    /// steps) need this only once.
    pub fn sources(&self, features: Tensor<2>) -> Tensor<2> {
        Rows::of(features).norm(&self.attn_prenorm_x_src).done()
    }

    /// Returns the new features of the destinations.
    ///
    /// - `destinations`: [N, h], raw; `sources`: [M, h], from [`RelationalAttention::sources`].
    /// - `neighbors`: up to K sources for each destination. A destination without sources uses only
    ///   its own transform.
    /// - `relations`: [N, K, r], one vector per slot, which several layers can share. They must be
    ///   [`normalize`](super::normalize)d if and only if the layer has `relation_norm`.
    pub fn forward(
        &self,
        destinations: Tensor<2>,
        sources: Tensor<2>,
        neighbors: &Neighbors,
        relations: &Relations,
        noise: &mut Noise,
    ) -> Tensor<2> {
        let own_norm = self.attn_prenorm_x_dst.as_ref().unwrap_or(&self.attn_prenorm_x_src);
        let own = Rows::of(destinations.clone()).norm(own_norm).done();
        let message = self.attend(own.clone(), sources, neighbors, relations, noise);
        let gate = linear(&self.to_g, Tensor::cat(vec![message.clone(), own.clone()], 1));
        let mixed = gated(gate, linear(&self.to_s, own), message);
        let x = destinations + Rows::linear(&self.to_out, mixed).norm(&self.attn_postnorm).done();
        let inner = Rows::of(x.clone()).norm(&self.ff_prenorm).done();
        let ff = self.ff_mlp.forward_dropping(inner, |hidden| noise.drop(hidden, self.hidden_dropout));
        x + Rows::of(ff).norm(&self.ff_postnorm).done()
    }

    /// Returns the messages from the neighbours, [N, heads · head_dim]; exactly 0 for a destination
    /// without neighbours.
    fn attend(
        &self,
        own: Tensor<2>,
        sources: Tensor<2>,
        neighbors: &Neighbors,
        relations: &Relations,
        noise: &mut Noise,
    ) -> Tensor<2> {
        let (count, heads, width) = (neighbors.destinations(), self.heads, self.heads * self.head_dim);
        if count == 0 || neighbors.slots() == 0 {
            return Tensor::zeros([count, width], &own.device());
        }
        let query = linear(&self.to_q, own) * (1.0 / (self.head_dim as f32).sqrt());
        let query = query.reshape([count, heads, self.head_dim]).swap_dims(0, 1);
        let (key_r, value_r) = (self.folded(&self.to_k_r), self.folded(&self.to_v_r));
        let to_sources = query.clone().matmul(self.keys(self.to_k.weight.val()));
        let to_relations = query.matmul(self.keys(key_r));
        let (of_sources, of_relations, weights) = match &relations.0 {
            RelationVectors::Host { vectors, of_edges } if !noise.active() => {
                let slots = neighbors.host(*of_edges);
                let (of_sources, of_relations) =
                    attend_to_neighbors(to_sources, to_relations, sources, vectors, &slots);
                (of_sources, of_relations, None)
            }
            _ => {
                let (to_sources, to_relations) = (to_sources.swap_dims(0, 1), to_relations.swap_dims(0, 1));
                let rows = relations.tensor(neighbors, &sources.device());
                let slot_sources = SlotSources::new(sources, neighbors);
                let scores = slot_sources.scores(to_sources)
                    + to_relations.matmul(rows.clone().swap_dims(1, 2))
                    + neighbors.closed();
                let weights = noise.drop(softmax(scores, 2), self.dropout);
                let (of_sources, of_relations) =
                    (slot_sources.sum(weights.clone()), weights.clone().matmul(rows));
                (of_sources.swap_dims(0, 1), of_relations.swap_dims(0, 1), Some(weights))
            }
        };
        let message = of_sources.matmul(self.values(self.to_v.weight.val()))
            + of_relations.matmul(self.values(value_r));
        let message = message.swap_dims(0, 1);
        let bias = self.value_bias(&message.device()).reshape([1, heads, self.head_dim]);
        let message = match weights.filter(|_| noise.active()) {
            // After dropout the weights do not sum to 1.
            Some(weights) => message + bias * weights.sum_dim(2),
            None => message + bias,
        };
        message.reshape([count, width]) * neighbors.any()
    }

    /// Returns the weights [r, a] of a relation projection, multiplied by the gain of the relation
    /// norm.
    fn folded(&self, projection: &Linear) -> Tensor<2> {
        match &self.attn_prenorm_r {
            Some(norm) => projection.weight.val() * norm.gamma.val().unsqueeze_dim::<2>(1),
            None => projection.weight.val(),
        }
    }

    /// Reshapes key weights from [in, a] to [heads, head_dim, in], to project queries into input
    /// space.
    fn keys(&self, weight: Tensor<2>) -> Tensor<3> {
        let inputs = weight.dims()[0];
        weight.reshape([inputs, self.heads, self.head_dim]).permute([1, 2, 0])
    }

    /// Reshapes value weights from [in, a] to [heads, in, head_dim].
    fn values(&self, weight: Tensor<2>) -> Tensor<3> {
        let inputs = weight.dims()[0];
        weight.reshape([inputs, self.heads, self.head_dim]).swap_dims(0, 1)
    }

    /// Returns the bias [a] that the values of all neighbours have in common.
    fn value_bias(&self, device: &Device) -> Tensor<1> {
        let mut sum = Tensor::zeros([self.heads * self.head_dim], device);
        for projection in [&self.to_v, &self.to_v_r] {
            if let Some(bias) = &projection.bias {
                sum = sum + bias.val();
            }
        }
        if let Some(beta) = self.attn_prenorm_r.as_ref().and_then(|norm| norm.beta.as_ref()) {
            let moved = beta.val().unsqueeze_dim::<2>(0).matmul(self.to_v_r.weight.val());
            sum = sum + moved.squeeze_dim(0);
        }
        sum
    }
}

/// Sources of all slots.
enum SlotSources<'a> {
    /// Gathered per slot, [N, K, h]: used if each destination has few of many sources.
    Gathered(Tensor<3>),
    /// All sources, [M, h]: used if most are neighbours of most destinations. One large product and
    /// a gather of its results take less time than a gather of features and many small products.
    All(Tensor<2>, &'a Neighbors),
}

impl<'a> SlotSources<'a> {
    fn new(sources: Tensor<2>, neighbors: &'a Neighbors) -> Self {
        // Not with rows of fixed length: results for a scene must not depend on the number of
        // scenes in the batch.
        if !neighbors.is_fixed() && sources.dims()[0] <= DENSE_SOURCES_PER_SLOT * neighbors.slots() {
            Self::All(sources, neighbors)
        } else {
            Self::Gathered(neighbors.sources(sources))
        }
    }

    /// Returns the products of vectors [N, heads, h] with the sources, [N, heads, K].
    fn scores(&self, vectors: Tensor<3>) -> Tensor<3> {
        match self {
            Self::Gathered(sources) => vectors.matmul(sources.clone().swap_dims(1, 2)),
            Self::All(sources, neighbors) => {
                let [count, heads, width] = vectors.dims();
                let table = sources.clone().matmul(vectors.reshape([count * heads, width]).transpose());
                let table = table.reshape([sources.dims()[0] * count, heads]);
                neighbors.pairs(table).swap_dims(1, 2)
            }
        }
    }

    /// Returns the sums of sources weighted by [N, heads, K], [N, heads, h].
    fn sum(&self, weights: Tensor<3>) -> Tensor<3> {
        match self {
            Self::Gathered(sources) => weights.matmul(sources.clone()),
            Self::All(sources, neighbors) => {
                let [count, heads, _] = weights.dims();
                let [all, width] = sources.dims();
                let table = neighbors.spread(weights.swap_dims(1, 2), all).reshape([all, count * heads]);
                table.transpose().matmul(sources.clone()).reshape([count, heads, width])
            }
        }
    }
}
