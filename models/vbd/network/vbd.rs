//! The whole network.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::config::VbdConfig;
use super::denoiser::Denoiser;
use super::encoded::Encoded;
use super::input::SceneInput;
use super::predictor::{Behaviours, Predictor};
use super::scene_encoder::SceneEncoder;
use crate::models::diffusion::{MotionNoise, roll_out};
use crate::models::nn::Initializer;

/// Deviation of accelerations, m/s², and yaw rates, rad/s: normalised actions have deviation 1.
pub(in crate::models::vbd) const DEVIATIONS: [f32; 2] = [1.0, 0.15];

/// Scene encoder, predictor of behaviours, denoiser.
#[derive(Module, Debug)]
pub struct Vbd {
    encoder: SceneEncoder,
    predictor: Predictor,
    denoiser: Denoiser,
}

impl Vbd {
    /// Creates a network with random weights.
    pub fn init(config: &VbdConfig, init: &mut Initializer) -> Self {
        Self {
            encoder: SceneEncoder::init(config, init),
            predictor: Predictor::init(config, init),
            denoiser: Denoiser::init(config, init),
        }
    }

    /// Encodes a scene.
    pub fn encode(&self, scene: &SceneInput, config: &VbdConfig, device: &Device) -> Encoded {
        self.encoder.forward(scene, config, device)
    }

    /// Predicts the behaviours of the first agents of a scene towards anchors, `[agents, anchors, 2]`, which are in their
    /// frames, metres.
    pub fn behaviours(&self, scene: &Encoded, anchors: Tensor<3>, config: &VbdConfig) -> Behaviours {
        self.predictor.forward(scene, anchors, config)
    }

    /// Returns the clean actions, `[agents, actions, 2]`, that the network takes noisy ones for; both normalised.
    /// `speeds` are those of the first agents of the scene, `[agents, 1]`, m/s; `level` is the noise level, from 0.
    pub fn denoise(
        &self,
        scene: &Encoded,
        noisy: Tensor<3>,
        speeds: &Tensor<2>,
        level: usize,
        config: &VbdConfig,
        noise: Option<&MotionNoise>,
    ) -> Tensor<3> {
        // Every agent starts at the origin of its frame.
        let [agents, _] = speeds.dims();
        let nothing = |columns| Tensor::<2>::zeros([agents, columns], &speeds.device());
        let start = Tensor::cat(vec![nothing(3), speeds.clone(), nothing(1)], 1);
        let states = roll_out(&start, unnormalized(noisy), config.hold, noise);
        self.denoiser.forward(scene, states, level, config)
    }
}

/// Returns actions, `[n, actions, 2]`, in m/s² and rad/s.
pub(in crate::models::vbd) fn unnormalized(actions: Tensor<3>) -> Tensor<3> {
    let deviations = Tensor::<1>::from_data(TensorData::from(DEVIATIONS), &actions.device());
    actions * deviations.reshape([1, 1, 2])
}
