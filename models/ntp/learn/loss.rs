//! Training loss: cross-entropy of the next token, smoothed toward tokens that end nearby.

use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::super::reactive::Config;
use super::super::reactive::batch::{SceneRows, map_tensors, node_tensors};
use super::super::reactive::network::{Network, PastNodes};
use super::super::tokens::Vocabulary;
use super::sample::{Sample, Target};
use crate::models::perception::Class;

/// Label smoothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Smoothing {
    /// Probability mass shared equally by all tokens (label smoothing).
    pub uniform: f64,
    /// Probability mass given to other tokens by proximity (spatial-aware smoothing of TrajTok, arXiv
    /// 2506.21618): proportional to 1 / (d + 1e-4)², where d is the mean distance in metres between the
    /// corners at the tokens' ends.
    pub spatial: f64,
}

/// Target distributions: one matrix per class, whose row is the distribution to learn if that token is
/// the label. Rows sum to 1.
pub(crate) struct TargetDistributions([Tensor<2>; 3]);

impl TargetDistributions {
    pub(crate) fn of(vocabulary: &Vocabulary, smoothing: &Smoothing, device: &Device) -> Self {
        Self(Class::ALL.map(|class| {
            let n = vocabulary.tokens(class);
            let values: Vec<f32> =
                (0..n).flat_map(|t| target_distribution(vocabulary, class, t, smoothing)).collect();
            Tensor::from_data(TensorData::new(values, [n, n]), device)
        }))
    }
}

/// Returns the distribution to learn if `token` is the label.
pub(crate) fn target_distribution(
    vocabulary: &Vocabulary,
    class: Class,
    token: usize,
    smoothing: &Smoothing,
) -> Vec<f32> {
    let n = vocabulary.tokens(class);
    let end = vocabulary.end(class, token);
    let near: Vec<f64> = (0..n)
        .map(|other| {
            let d = vocabulary.distance(class, other, end) / 4.0 + 1e-4;
            if other == token { 0.0 } else { 1.0 / (d * d) }
        })
        .collect();
    let total: f64 = near.iter().sum();
    let spatial = if total > 0.0 { smoothing.spatial } else { 0.0 };
    near.iter()
        .enumerate()
        .map(|(other, w)| {
            let own = if other == token { 1.0 - smoothing.uniform - spatial } else { 0.0 };
            let shared = smoothing.uniform / n as f64;
            let nearness = if total > 0.0 { spatial * w / total } else { 0.0 };
            (own + shared + nearness) as f32
        })
        .collect()
}

/// Sums of losses and metrics over samples.
pub(crate) struct Losses {
    /// Sum of weighted cross-entropies.
    pub loss: Tensor<1>,
    /// Sum of the weights.
    pub weight: f64,
    /// Sum of the weights of nodes whose likeliest token is the label.
    pub right: f64,
    /// Sum of weighted negative log-likelihoods of the labels, nats.
    pub surprise: f64,
}

/// Runs the network on samples.
pub(crate) fn losses(
    network: &Network,
    samples: &[Sample],
    target_distributions: &TargetDistributions,
    config: &Config,
    device: &Device,
) -> Losses {
    let maps: Vec<_> = samples.iter().map(|s| &s.linked).collect();
    let map = map_tensors(&maps, config, device);
    let (mut scenes, mut targets) = (Vec::new(), Vec::new());
    let (mut places, mut nodes) = (0, 0);
    for sample in samples {
        scenes.push((sample.steps.as_slice(), SceneRows { places, earlier: nodes }));
        targets.extend(sample.targets.iter().map(|t| Target { row: t.row + nodes, ..*t }));
        places += sample.linked.places.all.len();
        nodes += sample.steps.iter().map(|s| s.slots.len()).sum::<usize>();
    }
    let nodes = node_tensors(&scenes, config, device);
    let encoded = network.encode(&nodes, network.encode_map(&map), &PastNodes::Here);

    let mut total = Losses { loss: Tensor::zeros([1], device), weight: 0.0, right: 0.0, surprise: 0.0 };
    for class in Class::ALL {
        let own: Vec<&Target> = targets.iter().filter(|t| t.class == class).collect();
        if own.is_empty() {
            continue;
        }
        let ints = |values: Vec<i32>| {
            let n = values.len();
            Tensor::<1, Int>::from_data(TensorData::new(values, [n]), device)
        };
        let rows = ints(own.iter().map(|t| t.row as i32).collect());
        let labels = ints(own.iter().map(|t| t.token as i32).collect());
        let values: Vec<f32> = own.iter().map(|t| t.weight).collect();
        total.weight += values.iter().map(|&w| f64::from(w)).sum::<f64>();
        let weights = Tensor::<2>::from_data(TensorData::new(values, [own.len(), 1]), device);

        let logits = network.logits(class, encoded.nodes.clone().select(0, rows));
        let log_p = log_softmax(logits, 1);
        let target = target_distributions.0[class.index()].clone().select(0, labels.clone());
        total.loss = total.loss - (log_p.clone() * target * weights.clone()).sum();

        // Metrics only: no gradients needed.
        let log_p = log_p.inner();
        let weights = weights.inner();
        let labels = labels.inner().unsqueeze_dim::<2>(1);
        let likeliest = log_p.clone().argmax(1);
        let right = likeliest.equal(labels.clone()).float() * weights.clone();
        total.right += f64::from(right.sum().into_scalar::<f32>());
        total.surprise -= f64::from((log_p.gather(1, labels) * weights).sum().into_scalar::<f32>());
    }
    total
}
