//! The encoder: the surroundings of an agent as tokens that attend to their neighbours.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, MultiHeadAttention, Part, Rows};

use super::batch::Batch;
use super::config::Config;
use super::layers::Observed;
use super::polyline_encoder::PolylineEncoder;
use super::sine::sine;

/// Self-attention and a feed-forward network, each followed by a norm.
#[derive(Module, Debug)]
pub(crate) struct EncoderLayer {
    self_attn: MultiHeadAttention,
    linear1: Linear,
    linear2: Linear,
    norm1: LayerNorm,
    norm2: LayerNorm,
}

impl EncoderLayer {
    fn init(config: &Config, init: &mut Initializer) -> Self {
        let width = config.width;
        Self {
            self_attn: MultiHeadAttention::init(width, config.heads, init),
            linear1: init.linear(width, config.widening * width, true),
            linear2: init.linear(config.widening * width, width, true),
            norm1: init.norm(width),
            norm2: init.norm(width),
        }
    }

    fn forward(&self, x: Tensor<2>, positions: Tensor<2>, closed: Tensor<4>) -> Tensor<2> {
        let attention = &self.self_attn;
        let scenes = closed.dims()[0];
        // Values do not contain positions.
        let placed = x.clone() + positions;
        let [queries, keys] = [Part::Query, Part::Key].map(|part| attention.part(part, placed.clone()));
        let values = attention.part(Part::Value, x.clone());
        let taken = attention.take(scenes, queries, keys, values, closed);
        let x = attention.output(taken).plus(x).norm(&self.norm1).done();
        let wide = Rows::linear(&self.linear1, x.clone()).relu().done();
        Rows::linear(&self.linear2, wide).plus(x).norm(&self.norm2).done()
    }
}

/// The encoder.
#[derive(Module, Debug)]
pub(crate) struct Encoder {
    agent_polyline_encoder: PolylineEncoder,
    map_polyline_encoder: PolylineEncoder,
    self_attn_layers: Vec<EncoderLayer>,
}

/// Tokens of several scenes.
#[derive(Clone, Debug)]
pub(crate) struct Tokens {
    /// `[scenes * agents, width]`.
    pub agents: Tensor<2>,
    /// `[scenes * lines, width]`.
    pub lines: Tensor<2>,
}

impl Encoder {
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        Self {
            agent_polyline_encoder: PolylineEncoder::of_agents(config, init),
            map_polyline_encoder: PolylineEncoder::of_lines(config, init),
            self_attn_layers: (0..config.encoder_layers).map(|_| EncoderLayer::init(config, init)).collect(),
        }
    }

    /// Encodes agents and lines in the frames of the predicted agents.
    pub(crate) fn forward(&self, batch: &Batch, config: &Config, observed: &mut Observed) -> Tokens {
        let (scenes, width) = (batch.scenes, config.width);
        let (a, l) = (config.agents, config.lines);
        let agents =
            self.agent_polyline_encoder.forward(&batch.agent_points, observed) * batch.agents.there.clone();
        let lines =
            self.map_polyline_encoder.forward(&batch.line_points, observed) * batch.lines.there.clone();
        let join = |agents: Tensor<2>, lines: Tensor<2>, width: usize| {
            let both = vec![agents.reshape([scenes, a, width]), lines.reshape([scenes, l, width])];
            Tensor::cat(both, 1).reshape([scenes * (a + l), width])
        };
        let mut x = join(agents, lines, width);
        let positions = join(batch.agents.positions.clone(), batch.lines.positions.clone(), 2);
        let positions = sine(positions, width);
        for layer in &self.self_attn_layers {
            x = layer.forward(x, positions.clone(), batch.neighbours.clone());
        }
        let x = x.reshape([scenes, a + l, width]);
        Tokens {
            agents: x.clone().narrow(1, 0, a).reshape([scenes * a, width]),
            lines: x.narrow(1, a, l).reshape([scenes * l, width]),
        }
    }
}
