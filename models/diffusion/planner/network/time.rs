//! The embedding of the time of the diffusion.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use reactsim_nn::{Activation, Initializer, Perceptron, PerceptronKind};

use crate::waves::waves;

/// Number of cosines, and of sines.
const WAVES: usize = 128;

/// A perceptron of waves.
#[derive(Module, Debug)]
pub(super) struct TimeEmbedder {
    mlp: Perceptron,
}

impl TimeEmbedder {
    pub(super) fn init(width: usize, init: &mut Initializer) -> Self {
        let kind = PerceptronKind { activation: Activation::Silu, ..PerceptronKind::RELU };
        Self { mlp: kind.init(&[2 * WAVES, width, width], init) }
    }

    /// Returns `[1, width]` for a time from 0 to 1.
    pub(super) fn forward(&self, time: f64, device: &Device) -> Tensor<2> {
        self.mlp.forward(waves(time, WAVES, device))
    }
}
