//! Gated attention over neighbours, with a vector for every pair: the one block of the SMART family.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::activation::{sigmoid, softmax};
use burn::tensor::module::layer_norm;
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Serialize};

use super::{FeedForward, FeedForwardConfig, Initializer, Neighbors, Noise, Relations};

/// Layer norms of the published networks add this to variances.
const EPSILON: f64 = 1e-5;

/// With at most this many times as many sources as slots, products are taken with all sources.
const DENSE: usize = 3;

/// The measures of a [`RelationalAttention`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttentionConfig {
    /// Width h of the features.
    pub width: usize,
    /// Number of heads.
    pub heads: usize,
    /// Width of a head; heads × head_dim need not be the width.
    pub head_dim: usize,
    /// Width of the relation vectors (SMART: as the features).
    pub relation_width: usize,
    /// The feed-forward half.
    pub feed_forward: FeedForwardConfig,
    /// Whether sources and destinations have norms of their own (SMART: map to agents), or one norm for both.
    pub bipartite: bool,
    /// Whether relations pass a layer norm (SMART: yes). The caller normalises them, once for all layers: see
    /// [`RelationalAttention::forward`].
    pub relation_norm: bool,
    /// Share of attention weights and hidden features that training drops.
    pub dropout: f64,
}

/// Attention of destinations to their neighbours, where a relation vector is added to key and value of every pair; a gate between what
/// came in and the destination's own transform; a feed-forward network. Norms before and after both halves.
///
/// With k = Wk s + Wkr n and v = Wv s + Wvr n + b, a score is q·k = (Wkᵀq)·s + (Wkrᵀq)·n, and the sum of weighted values is
/// Wv Σws + Wvr Σwn + b Σw: nothing is projected per pair. The gain of the relation's norm goes into Wkr and Wvr, its bias is the same for
/// all neighbours of a destination, so that it falls out of the softmax and enters the values through Σw.
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
    ff_mlp: FeedForward,
    ff_postnorm: LayerNorm,
    heads: usize,
    head_dim: usize,
    dropout: f64,
}

impl AttentionConfig {
    /// A layer of these measures.
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
        }
    }
}

/// Zero mean and unit variance along the last axis, without gain and bias: what relations pass once, before all layers.
pub fn normalize<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    let dims = x.dims();
    let ones = Tensor::ones([dims[D - 1]], &x.device());
    layer_norm(x, ones, None, EPSILON)
}

impl RelationalAttention {
    /// Source features [M, h], normed as this layer wants them. Sources that do not change (a map, earlier steps) can be normed once.
    pub fn sources(&self, features: Tensor<2>) -> Tensor<2> {
        self.attn_prenorm_x_src.forward(features)
    }

    /// New features of the destinations.
    ///
    /// - `destinations`: [N, h], raw; `sources`: [M, h], from [`RelationalAttention::sources`].
    /// - `neighbors`: up to K sources for each destination. A destination without one keeps to its own transform.
    /// - `relations`: [N, K, r], the vector of each slot. If the layer was made with `relation_norm` they must have been
    ///   [`normalize`]d, else not.
    pub fn forward(
        &self,
        destinations: Tensor<2>,
        sources: Tensor<2>,
        neighbors: &Neighbors,
        relations: Tensor<3>,
        noise: &mut Noise,
    ) -> Tensor<2> {
        self.forward_with(destinations, sources, neighbors, &Relations::new(relations), noise)
    }

    /// As [`RelationalAttention::forward`], with relations that several layers share.
    pub fn forward_with(
        &self,
        destinations: Tensor<2>,
        sources: Tensor<2>,
        neighbors: &Neighbors,
        relations: &Relations,
        noise: &mut Noise,
    ) -> Tensor<2> {
        let own_norm = self.attn_prenorm_x_dst.as_ref().unwrap_or(&self.attn_prenorm_x_src);
        let own = own_norm.forward(destinations.clone());
        let message = self.attend(own.clone(), sources, neighbors, relations, noise);
        let gate = sigmoid(self.to_g.forward(Tensor::cat(vec![message.clone(), own.clone()], 1)));
        let mixed = message.clone() + gate * (self.to_s.forward(own) - message);
        let x = destinations + self.attn_postnorm.forward(self.to_out.forward(mixed));
        let ff = self.ff_mlp.forward(self.ff_prenorm.forward(x.clone()), self.dropout, noise);
        x + self.ff_postnorm.forward(ff)
    }

    /// What comes in from the neighbours: [N, heads · head_dim], exactly 0 where there is none.
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
        let query = self.to_q.forward(own) * (1.0 / (self.head_dim as f32).sqrt());
        let query = query.reshape([count, heads, self.head_dim]).swap_dims(0, 1);
        let (key_r, value_r) = (self.folded(&self.to_k_r), self.folded(&self.to_v_r));
        let to_sources = query.clone().matmul(self.keys(self.to_k.weight.val())).swap_dims(0, 1);
        let to_relations = query.matmul(self.keys(key_r)).swap_dims(0, 1);
        let near = Near::new(sources, neighbors);
        let scores =
            near.scores(to_sources) + to_relations.matmul(relations.columns.clone()) + neighbors.closed();
        let weights = noise.drop(softmax(scores, 2), self.dropout);

        let of_sources = near.sum(weights.clone()).swap_dims(0, 1);
        let of_relations = weights.clone().matmul(relations.rows.clone()).swap_dims(0, 1);
        let message = of_sources.matmul(self.values(self.to_v.weight.val()))
            + of_relations.matmul(self.values(value_r));
        let message = message.swap_dims(0, 1);
        let bias = self.value_bias(&message.device()).reshape([1, heads, self.head_dim]);
        let message = if noise.active() {
            message + bias * weights.sum_dim(2) // Weights that were dropped do not sum to 1.
        } else {
            message + bias
        };
        message.reshape([count, width]) * neighbors.any()
    }

    /// The weights of a relation's projection [r, a] with the gain of its norm.
    fn folded(&self, projection: &Linear) -> Tensor<2> {
        match &self.attn_prenorm_r {
            Some(norm) => projection.weight.val() * norm.gamma.val().unsqueeze_dim::<2>(1),
            None => projection.weight.val(),
        }
    }

    /// [in, a] to [heads, head_dim, in]: what turns queries into vectors that inputs are compared with.
    fn keys(&self, weight: Tensor<2>) -> Tensor<3> {
        let inputs = weight.dims()[0];
        weight.reshape([inputs, self.heads, self.head_dim]).permute([1, 2, 0])
    }

    /// [in, a] to [heads, in, head_dim].
    fn values(&self, weight: Tensor<2>) -> Tensor<3> {
        let inputs = weight.dims()[0];
        weight.reshape([inputs, self.heads, self.head_dim]).swap_dims(0, 1)
    }

    /// [a]: what every neighbour's value has in common.
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

/// The sources of all slots.
enum Near<'a> {
    /// Gathered, [N, K, h]: for few neighbours of many.
    Gathered(Tensor<3>),
    /// All of them, [M, h], when most are neighbours of most: one large product and a gather of its results take less time than a gather
    /// of features and many small products.
    All(Tensor<2>, &'a Neighbors),
}

impl<'a> Near<'a> {
    fn new(sources: Tensor<2>, neighbors: &'a Neighbors) -> Self {
        // Not where rows are of a fixed length: what is computed for a scene must not depend on how many share the batch.
        if !neighbors.is_fixed() && sources.dims()[0] <= DENSE * neighbors.slots() {
            Self::All(sources, neighbors)
        } else {
            Self::Gathered(neighbors.sources(sources))
        }
    }

    /// What vectors [N, heads, h] and sources have in common, [N, heads, K].
    fn scores(&self, vectors: Tensor<3>) -> Tensor<3> {
        match self {
            Self::Gathered(near) => vectors.matmul(near.clone().swap_dims(1, 2)),
            Self::All(sources, neighbors) => {
                let [count, heads, width] = vectors.dims();
                let table = sources.clone().matmul(vectors.reshape([count * heads, width]).transpose());
                let table = table.reshape([sources.dims()[0] * count, heads]);
                neighbors.pairs(table).swap_dims(1, 2)
            }
        }
    }

    /// Sums of sources with weights [N, heads, K], [N, heads, h].
    fn sum(&self, weights: Tensor<3>) -> Tensor<3> {
        match self {
            Self::Gathered(near) => weights.matmul(near.clone()),
            Self::All(sources, neighbors) => {
                let [count, heads, _] = weights.dims();
                let [all, width] = sources.dims();
                let table = neighbors.spread(weights.swap_dims(1, 2), all).reshape([all, count * heads]);
                table.transpose().matmul(sources.clone()).reshape([count, heads, width])
            }
        }
    }
}
