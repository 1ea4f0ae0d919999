//! An encoder that encodes a scene once for all predicted agents: every agent and line has a frame of its
//! own, and attention sees relative poses (as in QCNet, Zhou et al., CVPR 2023).

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use reactsim_nn::{
    AttentionConfig, FeedForwardConfig, Initializer, Perceptron, PerceptronKind, RelationalAttention,
};

use super::batch::{LineBatch, LineInput, SceneInput, SeenTensors};
use super::config::Config;
use super::encoder::Tokens;
use super::layers::Observed;
use super::polyline_encoder::PolylineEncoder;
use crate::inputs::{AGENT_FEATURES, LINE_FEATURES, POSE_FEATURES};

/// Attention of agents to lines and to one another.
#[derive(Module, Debug)]
pub(crate) struct SceneLayer {
    lines: RelationalAttention,
    agents: RelationalAttention,
}

/// The encoder. The last feature of every pose is 1 and replaces a bias.
#[derive(Module, Debug)]
pub(crate) struct SceneEncoder {
    agent_polyline_encoder: PolylineEncoder,
    map_polyline_encoder: PolylineEncoder,
    line_pair: Linear,
    map_layers: Vec<RelationalAttention>,
    to_line: Linear,
    to_agent: Linear,
    layers: Vec<SceneLayer>,
    /// Relations of agents and lines to a predicted agent, which are added to their tokens.
    seen_agent: Perceptron,
    seen_line: Perceptron,
}

impl SceneEncoder {
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        let (width, relation) = (config.width, config.relation_width);
        let attention = |bipartite| AttentionConfig {
            width,
            heads: config.heads,
            head_dim: width / config.heads,
            relation_width: relation,
            feed_forward: FeedForwardConfig::Relu(config.widening * width),
            bipartite,
            relation_norm: false,
            dropout: 0.0,
        };
        Self {
            agent_polyline_encoder: PolylineEncoder::of_agents(config, init),
            map_polyline_encoder: PolylineEncoder::of_lines(config, init),
            line_pair: init.linear(POSE_FEATURES, relation, false),
            map_layers: (0..config.map_layers).map(|_| attention(false).init(init)).collect(),
            to_line: init.linear(LINE_FEATURES, relation, false),
            to_agent: init.linear(AGENT_FEATURES, relation, false),
            layers: (0..config.encoder_layers)
                .map(|_| SceneLayer {
                    lines: attention(true).init(init),
                    agents: attention(false).init(init),
                })
                .collect(),
            seen_agent: PerceptronKind::RELU.init(&[AGENT_FEATURES, width, width], init),
            seen_line: PerceptronKind::RELU.init(&[LINE_FEATURES, width, width], init),
        }
    }

    /// Encodes the lines of maps, `[lines, width]`. The result holds for a whole episode: the states of
    /// lights enter with relations.
    pub(crate) fn encode_lines(&self, batch: &LineBatch, observed: &mut Observed) -> Tensor<2> {
        let relation = batch.links.embed(&self.line_pair);
        let mut x = self.map_polyline_encoder.forward(&batch.lines, observed);
        for layer in &self.map_layers {
            x = batch.links.attend(layer, x, None, &relation);
        }
        x
    }

    /// Encodes the agents of scenes, and returns agents and encoded lines as predicted agents see them.
    pub(crate) fn forward(&self, input: &SceneInput, observed: &mut Observed) -> Tokens {
        let lines = match &input.lines {
            LineInput::Points(lines) => self.encode_lines(lines, observed),
            LineInput::Encoded(lines) => lines.clone(),
        };
        let (to_lines, to_agents) =
            (input.to_lines.embed(&self.to_line), input.to_agents.embed(&self.to_agent));
        let mut x = self.agent_polyline_encoder.forward(&input.agents, observed);
        for layer in &self.layers {
            x = input.to_lines.attend(&layer.lines, x, Some(lines.clone()), &to_lines);
            x = input.to_agents.attend(&layer.agents, x, None, &to_agents);
        }
        Tokens {
            agents: seen(x, &input.seen_agents, &self.seen_agent),
            lines: seen(lines, &input.seen_lines, &self.seen_line),
        }
    }
}

/// Returns nodes as predicted agents see them.
fn seen(nodes: Tensor<2>, seen: &SeenTensors, relations: &Perceptron) -> Tensor<2> {
    let relations = relations.forward(seen.relations.clone());
    // Without nodes there is nothing to select; the rows are closed to attention.
    if nodes.dims()[0] == 0 { relations } else { nodes.select(0, seen.rows.clone()) + relations }
}
