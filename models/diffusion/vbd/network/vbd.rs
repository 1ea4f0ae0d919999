//! The whole network.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use reactsim_nn::Initializer;

use super::config::VbdConfig;
use super::denoiser::{Denoiser, DenoisingScene};
use super::input::SceneInput;
use super::predictor::{Behaviours, Predictor};
use super::scene_encoder::{Encoded, SceneEncoder};
use crate::own_motion;

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

    /// Prepares the denoising of the plans of the first agents of a scene, encoded from this input.
    /// `av_given` says that the plan of the AV, the first of them, will have no noise.
    pub fn prepare(
        &self,
        input: &SceneInput,
        scene: &Encoded,
        agents: usize,
        av_given: bool,
        config: &VbdConfig,
    ) -> DenoisingScene {
        let pairs = input.nearest(agents, agents, config.near_agents, config.zeros_are_absent);
        let others = self.encoder.relate(input, &pairs, config, &scene.elements.device());
        self.denoiser.prepare(scene, &pairs, others, av_given, config)
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
        let states = own_motion(noisy.clone(), speeds, config.hold);
        self.denoiser.forward(scene, noisy, states, level, config)
    }
}
