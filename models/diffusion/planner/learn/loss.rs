//! The loss of Diffusion-Planner: the squared error of denoised trajectories.

use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt;
use reactsim_nn::training::{Output, Stream, Sums};

use super::super::network::DiffusionPlanner;
use super::{Recipe, Sample};
use crate::{VariancePreserving, standard_normal};

/// Smallest time of the diffusion in training (published).
const EARLIEST: f64 = 1e-3;

/// Returns the loss of samples. Noise and its time are drawn from the stream.
pub(super) fn loss(
    network: &DiffusionPlanner,
    samples: &[Sample],
    recipe: &Recipe,
    stream: &mut Stream,
    device: &Device,
) -> Output {
    let (config, process) = (&recipe.network, VariancePreserving::default());
    let (count, numbers) = (1 + config.predicted, config.trajectory());
    let mut total = Tensor::<1>::zeros([1], device);
    let mut metrics = Sums::new();
    for sample in samples {
        let scene = network.encode(&sample.scene.input, config, device);
        let tensor = |values: &[f32]| {
            Tensor::<3>::from_data(TensorData::new(values.to_vec(), [1, count, numbers]), device)
        };
        let (truth, weights) = (tensor(&sample.truth), tensor(&sample.weights));
        for _ in 0..recipe.draws {
            let time = EARLIEST + (1.0 - EARLIEST) * stream.random::<f64>();
            let noise = standard_normal::<3>(stream, [1, count, numbers - 4], device);
            let future = truth.clone().narrow(2, 4, numbers - 4);
            let noisy = future * process.signal(time) + noise * process.deviation(time);
            let noisy = Tensor::cat(vec![truth.clone().narrow(2, 0, 4), noisy], 2);
            let apart = network.denoise(&scene, noisy, time) - truth.clone();
            let errors = apart.clone() * apart * weights.clone();
            let of_av = errors.clone().narrow(1, 0, 1).sum().into_scalar::<f32>();
            metrics.add("av", f64::from(of_av), 1.0);
            total = total + errors.sum();
        }
    }
    Output::new(total, (samples.len() * recipe.draws) as f64, metrics)
}
