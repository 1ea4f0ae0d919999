//! The loss: the squared difference of the motion that actions lead to from what was done.

use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt;
use reactsim_nn::training::{Output, Stream, Sums};

use super::super::inputs::Seen;
use super::super::network::{Ctg, CtgConfig, EncodedAgents, NUMBERS, trajectory, unnormalized_states};
use super::{Recipe, Sample};
use crate::{Schedule, standard_normal, unnormalized};

/// Returns the loss of samples. Noise and its levels are drawn from the stream.
pub(super) fn loss(
    network: &Ctg,
    samples: &[Sample],
    recipe: &Recipe,
    schedule: &Schedule,
    stream: &mut Stream,
    device: &Device,
) -> Output {
    let config = &recipe.network;
    let all: Vec<&Seen> = samples.iter().map(|sample| &sample.seen).collect();
    let (images, attributes, speeds) = Seen::tensors(&all, &recipe.sight, device);
    let agents = network.encode(images, attributes, speeds);
    let count = all.iter().map(|seen| seen.slots.len()).sum();
    let join = |part: fn(&Sample) -> &[f32]| samples.iter().flat_map(part).copied().collect();
    let (truth, weights): (Vec<f32>, Vec<f32>) = (join(|s| &s.truth), join(|s| &s.weights));
    let truth = Tensor::<3>::from_data(TensorData::new(truth, [count, config.actions, NUMBERS]), device);
    let weights = Tensor::<3>::from_data(TensorData::new(weights, [count, config.actions, 1]), device);
    let squares = match network.controls(&agents, config) {
        Some(controls) => cloned(controls, truth, &agents, recipe),
        None => denoised(network, samples, truth, &agents, config, schedule, stream),
    };
    let loss = (squares * weights).sum();
    Output::new(loss, samples.iter().map(|sample| sample.weight).sum(), Sums::new())
}

/// Returns the squared differences, `[agents, actions, 1]`, of places (m) and yaws (rad), as published, and
/// of the yaw rates from 0.
fn cloned(controls: Tensor<3>, truth: Tensor<3>, agents: &EncodedAgents, recipe: &Recipe) -> Tensor<3> {
    let found = trajectory(controls.clone(), &agents.speeds, &recipe.network);
    let apart = unnormalized_states(found) - unnormalized_states(truth);
    let (places, yaws) = (apart.clone().narrow(2, 0, 2), apart.narrow(2, 3, 1));
    let rates = unnormalized(controls).narrow(2, 1, 1);
    let apart = Tensor::cat(vec![places, yaws], 2);
    (apart.clone() * apart).sum_dim(2) + rates.clone() * rates * recipe.turning
}

/// Returns the mean squared differences of normalised trajectories, `[agents, actions, 1]`, after noise was
/// added to the true actions, of one level per scene, and taken away by the network.
fn denoised(
    network: &Ctg,
    samples: &[Sample],
    truth: Tensor<3>,
    agents: &EncodedAgents,
    config: &CtgConfig,
    schedule: &Schedule,
    stream: &mut Stream,
) -> Tensor<3> {
    let device = truth.device();
    let clean = truth.clone().narrow(2, NUMBERS - 2, 2);
    let (mut found, mut from) = (Vec::new(), 0);
    for sample in samples {
        let count = sample.seen.slots.len();
        let level = stream.random_range(0..schedule.steps());
        let noise = standard_normal(stream, [count, config.actions, 2], &device);
        let noisy = schedule.add_noise(clean.clone().narrow(0, from, count), noise, level);
        let scene = agents.narrow(from, count);
        found.push(trajectory(network.denoise(&scene, noisy, level, config), &scene.speeds, config));
        from += count;
    }
    let apart = Tensor::cat(found, 0) - truth;
    (apart.clone() * apart).mean_dim(2)
}
