//! The whole network.

use burn::module::Module;
use burn::tensor::Tensor;

use super::batch::Batch;
use super::config::Config;
use super::decoder::MotionDecoder;
use super::encoder::Encoder;
use crate::models::nn::Initializer;

/// Encoder and decoder.
#[derive(Module, Debug)]
pub struct Network {
    context_encoder: Encoder,
    motion_decoder: MotionDecoder,
}

/// Output of one layer of the decoder.
#[derive(Clone, Debug)]
pub(crate) struct LayerOutput {
    /// `[scenes, queries]`: unnormalised log-probabilities.
    pub scores: Tensor<2>,
    /// `[scenes * queries, states, 7]`, in the frame of the predicted agent.
    pub modes: Tensor<3>,
}

/// Output of the network.
#[derive(Clone, Debug)]
pub(crate) struct NetworkOutput {
    /// Outputs of the decoder layers; the last one counts.
    pub layers: Vec<LayerOutput>,
    /// `[scenes * agents, states, 7]`: one future of every agent in the input.
    pub dense: Tensor<3>,
}

impl Network {
    /// Creates a network with random weights.
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        Self {
            context_encoder: Encoder::init(config, init),
            motion_decoder: MotionDecoder::init(config, init),
        }
    }

    /// Predicts one agent per scene of the batch.
    pub(crate) fn forward(&self, batch: &Batch, config: &Config) -> NetworkOutput {
        let tokens = self.context_encoder.forward(batch, config);
        self.motion_decoder.forward(tokens, batch, config)
    }
}
