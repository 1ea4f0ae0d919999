//! The embedding of the time of the diffusion.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor};
use reactsim_geometry::math;
use reactsim_nn::{Initializer, linear};

use super::elements::matrix;

/// Number of cosines, and of sines.
const WAVES: usize = 128;
/// Longest wavelength, divided by 2π.
const LONGEST: f64 = 1e4;

/// Linear, SiLU, linear, of waves.
#[derive(Module, Debug)]
pub(super) struct TimeEmbedder {
    first: Linear,
    second: Linear,
}

impl TimeEmbedder {
    pub(super) fn init(width: usize, init: &mut Initializer) -> Self {
        Self { first: init.linear(2 * WAVES, width, true), second: init.linear(width, width, true) }
    }

    /// Returns `[1, width]` for a time from 0 to 1.
    pub(super) fn forward(&self, time: f64, device: &Device) -> Tensor<2> {
        let phases = (0..WAVES).map(|i| time * math::exp(-math::ln(LONGEST) * i as f64 / WAVES as f64));
        let waves = phases.clone().map(math::cos).chain(phases.map(math::sin));
        let waves = waves.map(|wave| wave as f32).collect();
        linear(&self.second, silu(linear(&self.first, matrix(waves, 2 * WAVES, device))))
    }
}
