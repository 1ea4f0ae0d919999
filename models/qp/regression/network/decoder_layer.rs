//! A layer in which queries attend to one another and to tokens.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::{Int, Tensor};
use reactsim_nn::{Initializer, Rows, dense_attention, linear};

/// Output projection of an attention whose input projections are separate fields.
#[derive(Module, Debug)]
pub(crate) struct Output {
    out_proj: Linear,
}

/// Self-attention of queries, attention to tokens and a feed-forward network, each followed by a norm
/// (conditional DETR, <https://arxiv.org/abs/2108.06152>, as MTR uses it).
#[derive(Module, Debug)]
pub(crate) struct DecoderLayer {
    sa_qcontent_proj: Linear,
    sa_qpos_proj: Linear,
    sa_kcontent_proj: Linear,
    sa_kpos_proj: Linear,
    sa_v_proj: Linear,
    self_attn: Output,
    norm1: LayerNorm,
    ca_qcontent_proj: Linear,
    ca_qpos_proj: Linear,
    ca_kcontent_proj: Linear,
    ca_kpos_proj: Linear,
    ca_v_proj: Linear,
    ca_qpos_sine_proj: Linear,
    cross_attn: Output,
    linear1: Linear,
    linear2: Linear,
    norm2: LayerNorm,
    norm3: LayerNorm,
    heads: usize,
}

/// Tokens that queries attend to.
#[derive(Clone, Debug)]
pub(crate) struct AttentionInput {
    /// `[scenes * n, width]`: the tokens.
    pub tokens: Tensor<2>,
    /// `[scenes * n, width]`: sine embeddings of their positions.
    pub positions: Tensor<2>,
    /// `[scenes, 1, queries or 1, n]`: added to scores.
    pub closed: Tensor<4>,
    /// `[scenes * queries, 1]`: 0 if there are no tokens, else 1.
    pub any: Tensor<2>,
}

/// Motion queries.
#[derive(Clone, Debug)]
pub(crate) struct Queries {
    /// `[scenes * queries, width]`: their content.
    pub content: Tensor<2>,
    /// Their intention points, encoded (static intention queries).
    pub intention: Chosen,
    /// Sine embeddings of their search positions (dynamic searching queries).
    pub searching: Chosen,
}

/// Rows of a table, one per query. Queries share rows, so layers are applied to the table.
#[derive(Clone, Debug)]
pub(crate) struct Chosen {
    /// `[n, width]`: the table.
    pub table: Tensor<2>,
    /// `[scenes * queries]`: rows of the table; `None` for all of them, in order.
    pub rows: Option<Tensor<1, Int>>,
}

impl Chosen {
    /// Returns the output of a linear layer for the chosen rows.
    fn through(&self, layer: &Linear) -> Tensor<2> {
        let table = linear(layer, self.table.clone());
        match &self.rows {
            Some(rows) => table.select(0, rows.clone()),
            None => table,
        }
    }
}

impl DecoderLayer {
    pub(crate) fn init(width: usize, heads: usize, widening: usize, init: &mut Initializer) -> Self {
        let square = |init: &mut Initializer| init.linear(width, width, true);
        // In the first layer queries have no content, so that their self-attention yields biases alone.
        // With zero biases the norm of a zero vector would follow, whose gradient is huge.
        let biased = |init: &mut Initializer| {
            let bound = 1.0 / (width as f64).sqrt();
            Linear { bias: Some(init.uniform([width], bound)), ..init.linear(width, width, false) }
        };
        Self {
            sa_qcontent_proj: square(init),
            sa_qpos_proj: square(init),
            sa_kcontent_proj: square(init),
            sa_kpos_proj: square(init),
            sa_v_proj: biased(init),
            self_attn: Output { out_proj: biased(init) },
            norm1: init.norm(width),
            ca_qcontent_proj: square(init),
            ca_qpos_proj: square(init),
            ca_kcontent_proj: square(init),
            ca_kpos_proj: square(init),
            ca_v_proj: square(init),
            ca_qpos_sine_proj: square(init),
            cross_attn: Output { out_proj: square(init) },
            linear1: init.linear(width, widening * width, true),
            linear2: init.linear(widening * width, width, true),
            norm2: init.norm(width),
            norm3: init.norm(width),
            heads,
        }
    }

    /// Returns the new contents of the queries. In the first layer intentions are added to queries and
    /// keys of the attention to tokens.
    pub(crate) fn forward(
        &self,
        queries: Queries,
        attended: &AttentionInput,
        first: bool,
        scenes: usize,
    ) -> Tensor<2> {
        let Queries { content, intention, searching } = queries;
        let q = linear(&self.sa_qcontent_proj, content.clone()) + intention.through(&self.sa_qpos_proj);
        let k = linear(&self.sa_kcontent_proj, content.clone()) + intention.through(&self.sa_kpos_proj);
        let v = linear(&self.sa_v_proj, content.clone());
        let all_open = Tensor::zeros([1, 1, 1, 1], &content.device());
        let taken = dense_attention(scenes, self.heads, vec![(q, k)], v, all_open);
        let x = Rows::linear(&self.self_attn.out_proj, taken).plus(content).norm(&self.norm1).done();

        let mut q = linear(&self.ca_qcontent_proj, x.clone());
        let mut k = linear(&self.ca_kcontent_proj, attended.tokens.clone());
        let v = linear(&self.ca_v_proj, attended.tokens.clone());
        let k_position = linear(&self.ca_kpos_proj, attended.positions.clone());
        if first {
            q = q + intention.through(&self.ca_qpos_proj);
            k = k + k_position.clone();
        }
        let sought = searching.through(&self.ca_qpos_sine_proj);
        let products = vec![(q, k), (sought, k_position)];
        let taken =
            dense_attention(scenes, self.heads, products, v, attended.closed.clone()) * attended.any.clone();
        let x = Rows::linear(&self.cross_attn.out_proj, taken).plus(x).norm(&self.norm2).done();
        let wide = Rows::linear(&self.linear1, x.clone()).relu().done();
        Rows::linear(&self.linear2, wide).plus(x).norm(&self.norm3).done()
    }
}
