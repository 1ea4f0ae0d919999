//! The whole network.

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use reactsim_nn::perception::Class;
use reactsim_nn::{Initializer, Perceptron, PerceptronKind, linear, mish};

use super::config::{CtgConfig, Decoding};
use super::denoiser::Denoiser;
use super::motion::trajectory;
use super::raster_encoder::RasterEncoder;
use crate::ctg::Sight;
use crate::waves::waves;

/// Numbers of an agent besides its image: speed, length, width, one number per class.
pub(crate) const ATTRIBUTES: usize = 3 + Class::ALL.len();
/// Number of cosines, and of sines, of a noise level.
const WAVES: usize = 16;

/// Encoder with a head for controls, or with a denoiser.
#[derive(Module, Debug)]
pub struct Ctg {
    encoder: RasterEncoder,
    attributes: Perceptron,
    controls: Option<Linear>,
    level: Option<Perceptron>,
    denoiser: Option<Denoiser>,
}

/// Agents as the network encoded them.
#[derive(Clone, Debug)]
pub struct EncodedAgents {
    /// `[n, features + attributes]`.
    features: Tensor<2>,
    /// Current speeds, `[n, 1]`, m/s.
    pub(crate) speeds: Tensor<2>,
}

impl EncodedAgents {
    /// Returns some of the agents.
    pub(crate) fn narrow(&self, from: usize, count: usize) -> Self {
        let Self { features, speeds } = self;
        Self {
            features: features.clone().narrow(0, from, count),
            speeds: speeds.clone().narrow(0, from, count),
        }
    }
}

impl Ctg {
    /// Creates a network with random weights.
    pub fn init(config: &CtgConfig, sight: &Sight, init: &mut Initializer) -> Self {
        let own = config.features / 2;
        let condition = config.features + own;
        let diffuses = config.decoding == Decoding::Diffusion;
        let waves = 2 * WAVES;
        Self {
            encoder: RasterEncoder::init(config, sight, init),
            attributes: PerceptronKind::RELU.init(&[ATTRIBUTES, own, own], init),
            controls: (!diffuses).then(|| init.linear(condition, 2 * config.actions, true)),
            level: diffuses.then(|| PerceptronKind::RELU.init(&[waves, 2 * waves, waves], init)),
            denoiser: diffuses.then(|| Denoiser::init(config.width, condition + waves, init)),
        }
    }

    /// Encodes agents by their images, `[n, pixels, pixels, channels]`, attributes, `[n, ATTRIBUTES]`, and
    /// speeds, `[n, 1]` (m/s).
    pub fn encode(&self, images: Tensor<4>, attributes: Tensor<2>, speeds: Tensor<2>) -> EncodedAgents {
        let features =
            Tensor::cat(vec![self.encoder.forward(images), self.attributes.forward(attributes)], 1);
        EncodedAgents { features, speeds }
    }

    /// Returns the normalised actions that the head finds, `[n, actions, 2]`; `None` if the network denoises.
    pub fn controls(&self, agents: &EncodedAgents, config: &CtgConfig) -> Option<Tensor<3>> {
        let head = self.controls.as_ref()?;
        let n = agents.features.dims()[0];
        Some(linear(head, agents.features.clone()).reshape([n, config.actions, 2]))
    }

    /// Returns the clean normalised actions found in noisy ones at a noise level, `[n, actions, 2]`; the
    /// noisy ones if the network does not denoise.
    pub fn denoise(
        &self,
        agents: &EncodedAgents,
        noisy: Tensor<3>,
        level: usize,
        config: &CtgConfig,
    ) -> Tensor<3> {
        let (Some(of_level), Some(denoiser)) = (&self.level, &self.denoiser) else { return noisy };
        let n = agents.features.dims()[0];
        let waves = waves(level as f64, WAVES, &noisy.device());
        let level = mish(of_level.forward(waves)).repeat_dim(0, n);
        let condition = Tensor::cat(vec![agents.features.clone(), level], 1);
        denoiser.forward(trajectory(noisy, &agents.speeds, config), &condition)
    }
}
