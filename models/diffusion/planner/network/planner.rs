//! The whole network, and how it is sampled.

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use reactsim_nn::{CLOSED, Initializer};

use super::PlannerConfig;
use super::encoder::Encoder;
use super::input::PlannerInput;
use super::transformer::Transformer;
use crate::{Guide, Moment, VariancePreserving, solve};

/// Number of steps of the solver, and the time at which it ends.
const STEPS: usize = 10;
const END: f64 = 1e-3;

/// Encoder and diffusion transformer.
#[derive(Module, Debug)]
pub struct DiffusionPlanner {
    encoder: Encoder,
    transformer: Transformer,
}

/// An encoded scene.
#[derive(Clone, Debug)]
pub struct EncodedPlan {
    /// `[elements, width]`.
    pub(super) scene: Tensor<2>,
    /// `[1, width]`.
    pub(super) route: Tensor<2>,
    /// Current states, `[1 + predicted, 4]`, normalised.
    current: Tensor<2>,
    /// Added to the scores of trajectories as keys, `[1, 1, 1, 1 + predicted]`: closed if their agent is
    /// absent.
    pub(super) closed: Tensor<4>,
}

impl DiffusionPlanner {
    /// Creates a network with random weights.
    pub fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        Self { encoder: Encoder::init(config, init), transformer: Transformer::init(config, init) }
    }

    /// Encodes a scene.
    pub fn encode(&self, input: &PlannerInput, config: &PlannerConfig, device: &Device) -> EncodedPlan {
        let count = 1 + config.predicted;
        let key = |there: bool| if there { 0.0 } else { CLOSED };
        let closed: Vec<f32> = std::iter::once(true).chain(input.predicted(config)).map(key).collect();
        EncodedPlan {
            scene: self.encoder.forward(input, config, device),
            route: self.transformer.route_encoder.forward(input, config, device),
            current: Tensor::from_data(TensorData::new(input.current.clone(), [count, 4]), device),
            closed: Tensor::from_data(TensorData::new(closed, [1, 1, 1, count]), device),
        }
    }

    /// Returns the clean trajectories found in noisy ones at a time from 0 to 1, `[samples, 1 + predicted,
    /// 4 (1 + states)]`, normalised: by state x, y, cosine and sine of the heading, the current state first.
    pub fn denoise(&self, scene: &EncodedPlan, noisy: Tensor<3>, time: f64) -> Tensor<3> {
        self.transformer.forward(noisy, time, scene)
    }

    /// Samples trajectories by the published solver from noise, `[samples, 1 + predicted, 4 states]`, whose
    /// deviation is the temperature (published: 0.5). Returns them without the current state, `[samples, 1 +
    /// predicted, states, 4]`, normalised. Those of absent neighbours mean nothing.
    pub fn sample(&self, scene: &EncodedPlan, noise: Tensor<3>) -> Tensor<4> {
        let [samples, count, numbers] = noise.dims();
        let current = scene.current.clone().unsqueeze_dim::<3>(0).repeat_dim(0, samples);
        let start = Tensor::cat(vec![current.clone(), noise], 2);
        let denoise = |x, time| self.denoise(scene, x, time);
        let mut keep = KeepCurrent(current);
        let clean = solve(&VariancePreserving::default(), STEPS, END, start, denoise, &mut keep);
        clean.narrow(2, 4, numbers).reshape([samples, count, numbers / 4, 4])
    }
}

/// Resets the current states after every step.
struct KeepCurrent(Tensor<3>);

impl Guide<3> for KeepCurrent {
    fn guide(&mut self, mean: Tensor<3>, _: &Tensor<3>, _: Moment) -> Tensor<3> {
        let numbers = mean.dims()[2];
        Tensor::cat(vec![self.0.clone(), mean.narrow(2, 4, numbers - 4)], 2)
    }
}
