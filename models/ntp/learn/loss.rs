//! Training loss of the reactive network.

use burn::tensor::Device;
use reactsim_nn::training::Output;

use super::super::reactive::Config;
use super::super::reactive::batch::{SceneRows, map_tensors, node_tensors};
use super::super::reactive::network::{Network, PastNodes};
use super::super::smoothing::TargetDistributions;
use super::super::token_loss::{Target, token_loss};
use super::sample::Sample;

/// Runs the network on samples.
pub(crate) fn loss(
    network: &Network,
    samples: &[Sample],
    distributions: &TargetDistributions,
    config: &Config,
    device: &Device,
) -> Output {
    let maps: Vec<_> = samples.iter().map(|s| &s.linked).collect();
    let map = map_tensors(&maps, config, device);
    let (mut scenes, mut targets) = (Vec::new(), Vec::new());
    let (mut places, mut nodes) = (0, 0);
    for sample in samples {
        scenes.push((sample.steps.as_slice(), SceneRows { places, earlier: nodes, ..SceneRows::default() }));
        targets.extend(sample.targets.iter().map(|t| Target { row: t.row + nodes, ..*t }));
        places += sample.linked.places.all.len();
        nodes += sample.steps.iter().map(|s| s.slots.len()).sum::<usize>();
    }
    let nodes = node_tensors(&scenes, config, device);
    let encoded = network.encode(&nodes, &network.encode_map(&map), &PastNodes::Here, None);
    token_loss(&targets, distributions, device, |class, rows| {
        network.logits(class, encoded.nodes.clone().select(0, rows))
    })
}
