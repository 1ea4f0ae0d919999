//! The behaviour predictor: actions of each agent towards each of its anchors, and scores of the anchors.

use burn::module::Module;
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Perceptron, PerceptronKind};

use super::config::VbdConfig;
use super::cross_block::CrossBlock;
use super::perceptrons::ELU;
use super::scene_encoder::Encoded;

/// Predicts behaviours.
#[derive(Module, Debug)]
pub(super) struct Predictor {
    anchor_encoder: Perceptron,
    attention_layers: Vec<CrossBlock>,
    act_decoder: Perceptron,
    score_decoder: Perceptron,
}

/// Behaviours of agents.
#[derive(Clone, Debug)]
pub struct Behaviours {
    /// Normalised actions towards each anchor, `[agents, anchors, actions, 2]`.
    pub actions: Tensor<4>,
    /// Scores of the anchors, `[agents, anchors]`.
    pub scores: Tensor<2>,
}

impl Predictor {
    pub(super) fn init(config: &VbdConfig, init: &mut Initializer) -> Self {
        let (d, h) = (config.width, config.hidden);
        Self {
            anchor_encoder: PerceptronKind::RELU.init(&[2, h, d], init),
            attention_layers: (0..2 * config.pairs)
                .map(|_| CrossBlock::init(d, config.heads, init))
                .collect(),
            act_decoder: ELU.init(&[d, d, 2 * config.actions], init),
            score_decoder: ELU.init(&[d, h, 1], init),
        }
    }

    /// Predicts the first agents of a scene; `anchors`, `[agents, anchors, 2]`, are in their frames, metres.
    pub(super) fn forward(&self, scene: &Encoded, anchors: Tensor<3>, config: &VbdConfig) -> Behaviours {
        let [agents, count, _] = anchors.dims();
        let d = config.width;
        let anchors = self.anchor_encoder.forward(anchors.reshape([agents * count, 2]));
        let own = scene.agents(agents).unsqueeze_dim::<3>(1);
        let first = (anchors.reshape([agents, count, d]) + own).reshape([agents * count, d]);
        let seen = scene.surroundings.first(agents);
        let mut x = first.clone();
        for (i, pair) in self.attention_layers.chunks(2).enumerate() {
            if i > 0 {
                x = x + first.clone();
            }
            x = pair.iter().fold(x, |x, block| {
                let sources = block.sources(&seen, &block.relate(&seen), &scene.elements, 1);
                block.forward(agents, x, sources, &seen.closed, config.residual)
            });
        }
        let actions = self.act_decoder.forward(x.clone());
        Behaviours {
            actions: actions.reshape([agents, count, config.actions, 2]),
            scores: self.score_decoder.forward(x).reshape([agents, count]),
        }
    }
}
