//! The whole network.

use burn::module::Module;
use reactsim_nn::Initializer;

use super::batch::Batch;
use super::config::Config;
use super::decoder::MotionDecoder;
use super::encoder::Encoder;
use super::output::NetworkOutput;

/// Encoder and decoder.
#[derive(Module, Debug)]
pub struct Network {
    pub(super) context_encoder: Encoder,
    motion_decoder: MotionDecoder,
}

impl Network {
    /// Creates a network with random weights.
    pub(crate) fn init(config: &Config, init: &mut Initializer) -> Self {
        Self {
            context_encoder: Encoder::init(config, init),
            motion_decoder: MotionDecoder::init(config, init),
        }
    }

    /// Removes layers of the decoder, the last ones first.
    pub(crate) fn with_decoder_layers(mut self, count: usize) -> Self {
        self.motion_decoder.truncate(count);
        self
    }

    /// Predicts one agent per scene of the batch. In training, batch norms use the means and variances of
    /// their rows; otherwise the running ones.
    pub(crate) fn forward(&self, batch: &Batch, config: &Config, training: bool) -> NetworkOutput {
        let mut observed = training.then(Vec::new);
        let tokens = self.context_encoder.forward(batch, config, &mut observed);
        let (layers, dense) = self.motion_decoder.forward(tokens, batch, config, &mut observed);
        NetworkOutput { layers, dense, averages: observed.unwrap_or_default() }
    }
}
