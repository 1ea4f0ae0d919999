//! The whole network.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use super::config::VbdConfig;
use super::denoiser::{Denoiser, DenoisingScene};
use super::encoded::Encoded;
use super::input::SceneInput;
use super::predictor::{Behaviours, Predictor};
use super::scene_encoder::SceneEncoder;
use crate::models::diffusion::roll_out;
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

    /// Predicts the behaviours of the first agents of a scene towards anchors, `[agents, anchors, 2]`, which
    /// are in their frames, metres.
    pub fn behaviours(&self, scene: &Encoded, anchors: Tensor<3>, config: &VbdConfig) -> Behaviours {
        self.predictor.forward(scene, anchors, config)
    }

    /// Prepares the denoising of the plans of the first agents of a scene.
    pub fn prepare(&self, scene: &Encoded, agents: usize, config: &VbdConfig) -> DenoisingScene {
        self.denoiser.prepare(scene, agents, config)
    }

    /// Returns the clean actions, `[agents, actions, 2]`, that the network takes noisy ones for; both
    /// normalised. `speeds` are those of the agents, `[agents, 1]`, m/s; `level` is the noise level, from 0.
    pub fn denoise(
        &self,
        scene: &DenoisingScene,
        noisy: Tensor<3>,
        speeds: &Tensor<2>,
        level: usize,
        config: &VbdConfig,
    ) -> Tensor<3> {
        debug_assert_eq!([scene.agents, 1], speeds.dims());
        self.denoiser.forward(scene, own_motion(noisy, speeds, config), level, config)
    }
}

/// Returns the states to which normalised actions, `[agents, actions, 2]`, lead from speeds, `[agents, 1]`,
/// m/s, each agent starting at the origin of its frame: `[agents, states, 5]`.
pub(in crate::models::vbd) fn own_motion(
    actions: Tensor<3>,
    speeds: &Tensor<2>,
    config: &VbdConfig,
) -> Tensor<3> {
    let agents = speeds.dims()[0];
    let nothing = |columns| Tensor::<2>::zeros([agents, columns], &speeds.device());
    let start = Tensor::cat(vec![nothing(3), speeds.clone(), nothing(1)], 1);
    roll_out(&start, unnormalized(actions), config.hold, None)
}

/// Returns actions, `[n, actions, 2]`, in m/s² and rad/s.
pub(in crate::models::vbd) fn unnormalized(actions: Tensor<3>) -> Tensor<3> {
    let deviations = Tensor::<1>::from_data(TensorData::from(DEVIATIONS), &actions.device());
    actions * deviations.reshape([1, 1, 2])
}
