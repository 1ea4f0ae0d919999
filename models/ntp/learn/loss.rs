//! Training loss of the reactive network.

use burn::tensor::{Device, Tensor};
use reactsim_nn::training::Output;

use super::super::reactive::Config;
use super::super::reactive::batch::{SceneRows, map_tensors, node_tensors};
use super::super::reactive::network::{Network, PastNodes};
use super::super::smoothing::TargetDistributions;
use super::super::token_loss::{Target, first_rows, token_loss};
use super::sample::Sample;

/// Runs the network on samples.
pub(crate) fn loss(
    network: &Network,
    samples: &[Sample],
    distributions: &TargetDistributions,
    config: &Config,
    device: &Device,
) -> Output {
    let targets: Vec<Target> = samples
        .iter()
        .zip(first_rows(samples.iter().map(Sample::nodes)))
        .flat_map(|(sample, first)| sample.targets.iter().map(move |target| target.in_batch(first)))
        .collect();
    let nodes = encoded(network, samples, config, device);
    token_loss(&targets, distributions, device, |class, rows| {
        network.logits(class, nodes.clone().select(0, rows))
    })
}

/// Returns the features of all nodes of samples, [nodes, hidden].
fn encoded(network: &Network, samples: &[Sample], config: &Config, device: &Device) -> Tensor<2> {
    let maps: Vec<_> = samples.iter().map(|s| &s.linked).collect();
    let map = map_tensors(&maps, config, device);
    let mut scenes = Vec::new();
    let mut places = 0;
    for (sample, earlier) in samples.iter().zip(first_rows(samples.iter().map(Sample::nodes))) {
        scenes.push((sample.steps.as_slice(), SceneRows { places, earlier, ..SceneRows::default() }));
        places += sample.linked.places.all.len();
    }
    let nodes = node_tensors(&scenes, config, device);
    network.encode(&nodes, &network.encode_map(&map), &PastNodes::Here, None).nodes
}
