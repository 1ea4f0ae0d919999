//! The encoder of the route.

use burn::module::Module;
use burn::nn::LayerNorm;
use burn::tensor::{Device, Tensor};
use reactsim_nn::{Initializer, Perceptron, Rows};

use super::PlannerConfig;
use super::elements::matrix;
use super::input::{POINT, PlannerInput};
use super::mixer::Mixer;
use super::perceptron::{GELU, map_middle};

/// Numbers of a point that are read: position, and the way to the next point.
const READ: usize = 4;
const CHANNELS: usize = 64;
const TOKENS: usize = 32;

/// Encodes the route as one vector.
#[derive(Module, Debug)]
pub(super) struct RouteEncoder {
    channel_pre_project: Perceptron,
    token_pre_project: Perceptron,
    mixer: Mixer,
    norm: LayerNorm,
    emb_project: Perceptron,
}

impl RouteEncoder {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        let points = config.route * config.points;
        Self {
            channel_pre_project: GELU.init(&[READ, CHANNELS, CHANNELS], init),
            token_pre_project: GELU.init(&[points, TOKENS, TOKENS], init),
            mixer: Mixer::init(TOKENS, CHANNELS, init),
            norm: init.norm(CHANNELS),
            emb_project: GELU.init(&[CHANNELS, config.width, config.width], init),
        }
    }

    /// Returns `[1, width]`; zeros without a route.
    pub(super) fn forward(&self, input: &PlannerInput, config: &PlannerConfig, device: &Device) -> Tensor<2> {
        let points: Vec<f32> = input.route.chunks(POINT).flat_map(|p| p[..READ].iter().copied()).collect();
        if points.iter().all(|v| *v == 0.0) {
            return Tensor::zeros([1, config.width], device);
        }
        let x = self.channel_pre_project.forward(matrix(points, READ, device));
        let x = x.reshape([1, config.route * config.points, CHANNELS]);
        let x = self.mixer.forward(map_middle(&self.token_pre_project, x));
        let x = x.mean_dim(1).squeeze_dim::<2>(1);
        self.emb_project.forward(Rows::of(x).norm(&self.norm).done())
    }
}
