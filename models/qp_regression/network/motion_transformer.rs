//! The whole network.

use burn::module::Module;
use burn::tensor::Tensor;
use reactsim_nn::Initializer;

use super::batch::{Batch, EncoderInput, LineBatch};
use super::config::{Config, Encoding};
use super::decoder::MotionDecoder;
use super::encoder::Encoder;
use super::output::NetworkOutput;
use super::scene_encoder::SceneEncoder;

/// Encoder and decoder. One of the two encoders is present.
#[derive(Module, Debug)]
pub struct Network {
    pub(super) context_encoder: Option<Encoder>,
    scene_encoder: Option<SceneEncoder>,
    motion_decoder: MotionDecoder,
}

impl Network {
    /// Creates a network with random weights.
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        let once = config.encoding == Encoding::SceneCentric;
        Self {
            context_encoder: (!once).then(|| Encoder::init(config, init)),
            scene_encoder: once.then(|| SceneEncoder::init(config, init)),
            motion_decoder: MotionDecoder::init(config, init),
        }
    }

    /// Removes layers of the decoder, the last ones first.
    pub(crate) fn with_decoder_layers(mut self, count: usize) -> Self {
        self.motion_decoder.truncate(count);
        self
    }

    /// Encodes lines for [`Batch::of`]; `None` if the network encodes the surroundings of every agent.
    pub(crate) fn encode_lines(&self, lines: &LineBatch) -> Option<Tensor<2>> {
        self.scene_encoder.as_ref().map(|encoder| encoder.encode_lines(lines, &mut None))
    }

    /// Predicts one agent per scene of the batch. In training, batch norms use the means and variances of their
    /// rows; otherwise the running ones.
    pub(crate) fn forward(&self, batch: &Batch, config: &Config, training: bool) -> NetworkOutput {
        let mut observed = training.then(Vec::new);
        let tokens = match (&batch.encoder, &self.context_encoder, &self.scene_encoder) {
            (EncoderInput::AgentCentric(input), Some(encoder), _) => {
                encoder.forward(input, batch, config, &mut observed)
            }
            (EncoderInput::SceneCentric(input), _, Some(encoder)) => encoder.forward(input, &mut observed),
            _ => unreachable!("batches and encoders are built from the same configuration"),
        };
        let (layers, dense) = self.motion_decoder.forward(tokens, batch, config, &mut observed);
        NetworkOutput { layers, dense, averages: observed.unwrap_or_default() }
    }
}
