//! The embedding of the time of the diffusion.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use reactsim_geometry::math;
use reactsim_nn::{Activation, Initializer, Perceptron, PerceptronKind};

use super::elements::matrix;

/// Number of cosines, and of sines.
const WAVES: usize = 128;
/// Longest wavelength, divided by 2π.
const LONGEST: f64 = 1e4;

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
        let phases = (0..WAVES).map(|i| time * math::exp(-math::ln(LONGEST) * i as f64 / WAVES as f64));
        let waves = phases.clone().map(math::cos).chain(phases.map(math::sin));
        let waves = waves.map(|wave| wave as f32).collect();
        self.mlp.forward(matrix(waves, 2 * WAVES, device))
    }
}
