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

/// What one layer of the decoder predicts.
#[derive(Clone, Debug)]
pub(crate) struct PredictedLayer {
    /// `[scenes, queries]`: unnormalised log-probabilities.
    pub scores: Tensor<2>,
    /// `[scenes * queries, states, 7]`, in the frame of the predicted agent.
    pub modes: Tensor<3>,
}

/// What is predicted.
#[derive(Clone, Debug)]
pub(crate) struct Predicted {
    /// By the layers of the decoder; the last one counts.
    pub layers: Vec<PredictedLayer>,
    /// `[scenes * agents, states, 7]`: one future of everybody who is shown.
    pub dense: Tensor<3>,
}

impl Network {
    /// A network with fresh weights.
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        Self {
            context_encoder: Encoder::init(config, init),
            motion_decoder: MotionDecoder::init(config, init),
        }
    }

    /// Predicts one agent per scene of the batch.
    pub(crate) fn forward(&self, batch: &Batch, config: &Config) -> Predicted {
        let tokens = self.context_encoder.forward(batch, config);
        self.motion_decoder.forward(tokens, batch, config)
    }
}
