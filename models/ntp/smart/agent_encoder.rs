//! Agent half of the network.

use burn::module::Module;
use burn::nn::Embedding;
use burn::tensor::{Device, Tensor};
use reactsim_nn::{FourierEmbedding, Initializer, Perceptron, PerceptronKind, RelationalAttention};

use super::tables::{pick, rows};
use super::{Agents, SmartConfig, TokenHead};

/// Encoder of agents: they attend to their own past, to the map and to one another, then tokens are
/// scored.
#[derive(Module, Debug)]
pub struct AgentEncoder {
    token_emb_veh: Perceptron,
    token_emb_ped: Perceptron,
    token_emb_cyc: Perceptron,
    type_a_emb: Embedding,
    shape_emb: Perceptron,
    x_a_emb: FourierEmbedding,
    fusion_emb: Perceptron,
    pub(super) r_t_emb: FourierEmbedding,
    pub(super) r_pt2a_emb: FourierEmbedding,
    pub(super) r_a2a_emb: FourierEmbedding,
    pub(super) t_attn_layers: Vec<RelationalAttention>,
    pub(super) pt2a_attn_layers: Vec<RelationalAttention>,
    pub(super) a2a_attn_layers: Vec<RelationalAttention>,
    pub(super) token_predict_head: TokenHead,
}

impl AgentEncoder {
    pub(super) fn init(config: &SmartConfig, init: &mut Initializer) -> Self {
        let (h, first, bands) = (config.hidden_dim, config.mlp_embedding_first_width, config.num_freq_bands);
        let layers = |bipartite, init: &mut Initializer| {
            (0..config.num_agent_layers).map(|_| config.attention(bipartite).init(init)).collect()
        };
        Self {
            token_emb_veh: PerceptronKind::SMART.init(&[8, first, h, h], init),
            token_emb_ped: PerceptronKind::SMART.init(&[8, first, h, h], init),
            token_emb_cyc: PerceptronKind::SMART.init(&[8, first, h, h], init),
            type_a_emb: init.embedding(config.agent_types, h),
            shape_emb: PerceptronKind::SMART.init(&[3, h, h], init),
            x_a_emb: FourierEmbedding::init(2, bands, h, init),
            fusion_emb: PerceptronKind::SMART.init(&[2 * h, first, h, h], init),
            r_t_emb: FourierEmbedding::init(4, bands, h, init),
            r_pt2a_emb: FourierEmbedding::init(3, bands, h, init),
            r_a2a_emb: FourierEmbedding::init(3, bands, h, init),
            t_attn_layers: layers(false, init),
            pt2a_attn_layers: layers(true, init),
            a2a_attn_layers: layers(false, init),
            token_predict_head: TokenHead::init(config, init),
        }
    }

    /// Returns the encoder with all embeddings fixed.
    pub(super) fn with_frozen_embeddings(self) -> Self {
        Self {
            token_emb_veh: self.token_emb_veh.no_grad(),
            token_emb_ped: self.token_emb_ped.no_grad(),
            token_emb_cyc: self.token_emb_cyc.no_grad(),
            type_a_emb: self.type_a_emb.no_grad(),
            shape_emb: self.shape_emb.no_grad(),
            x_a_emb: self.x_a_emb.no_grad(),
            fusion_emb: self.fusion_emb.no_grad(),
            r_t_emb: self.r_t_emb.no_grad(),
            r_pt2a_emb: self.r_pt2a_emb.no_grad(),
            r_a2a_emb: self.r_a2a_emb.no_grad(),
            ..self
        }
    }

    pub(super) fn token_embedding(&self, class: usize) -> &Perceptron {
        [&self.token_emb_veh, &self.token_emb_ped, &self.token_emb_cyc][class]
    }

    /// Returns the relation embeddings of an agent's own steps, of map tokens to agents, and among
    /// agents.
    pub fn relation_embeddings(&self) -> [&FourierEmbedding; 3] {
        [&self.r_t_emb, &self.r_pt2a_emb, &self.r_a2a_emb]
    }

    /// Returns the features of agents that do not depend on motion: class and shape, [A, h].
    pub(super) fn identities(&self, agents: &Agents, device: &Device) -> Tensor<2> {
        let class = pick(&self.type_a_emb.weight.val(), agents.class.iter().map(|c| usize::from(*c)));
        if agents.is_empty() {
            return class;
        }
        class + self.shape_emb.forward(rows(&agents.shape, device))
    }

    /// Returns the input of the first block, [N, h], from token vectors [N, h], identities [N, h] and
    /// motions.
    pub(super) fn embed(&self, tokens: Tensor<2>, identities: Tensor<2>, motion: &[[f32; 2]]) -> Tensor<2> {
        let device = tokens.device();
        let motion = self.x_a_emb.forward_host(motion.as_flattened(), Some(identities), &device);
        self.fusion_emb.forward(Tensor::cat(vec![tokens, motion], 1))
    }
}
