//! Loss of next-token prediction: the cross-entropy of smoothed labels.

use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};
use reactsim_nn::indices;
use reactsim_nn::learning::LearningScene;
use reactsim_nn::perception::Class;
use reactsim_nn::training::{Output, Sums};

use super::smoothing::TargetDistributions;

/// Loss weight of parked agents; that of others is 1.
const PARKED_WEIGHT: f32 = 0.05;

/// Label of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Target {
    /// Row of the node.
    pub row: usize,
    /// Class of the agent.
    pub class: Class,
    /// Token to choose.
    pub token: usize,
    /// Weight in the loss.
    pub weight: f32,
}

impl Target {
    /// Returns the target in a batch in which the first node of its sample is in this row.
    pub(crate) fn in_batch(self, first: usize) -> Self {
        Self { row: self.row + first, ..self }
    }
}

/// Returns the row of the first node of each sample in a batch, from the numbers of their nodes.
pub(crate) fn first_rows(nodes: impl Iterator<Item = usize>) -> impl Iterator<Item = usize> {
    nodes.scan(0, |next, count| {
        let first = *next;
        *next += count;
        Some(first)
    })
}

/// Agent and frame of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Chooser {
    /// Slot of the agent.
    pub slot: usize,
    /// Frame from which the token leads on.
    pub frame: usize,
}

/// Returns the weight of an agent's labels in the loss.
pub(crate) fn loss_weight<M>(scene: &LearningScene<M>, slot: usize) -> f32 {
    if scene.is_parked(slot) { PARKED_WEIGHT } else { 1.0 }
}

/// Returns loss, accuracy and surprise (mean negative log-likelihood of the labels, nats) of scores.
/// `scores` returns those of the given rows of nodes of a class, [rows, tokens of the class].
pub(crate) fn token_loss(
    targets: &[Target],
    distributions: &TargetDistributions,
    device: &Device,
    scores: impl Fn(Class, Tensor<1, Int>) -> Tensor<2>,
) -> Output {
    let mut loss = Tensor::zeros([1], device);
    let (mut weight, mut right, mut surprise) = (0.0, 0.0, 0.0);
    for class in Class::ALL {
        let own: Vec<&Target> = targets.iter().filter(|t| t.class == class).collect();
        if own.is_empty() {
            continue;
        }
        let rows = indices(own.iter().map(|t| t.row), device);
        let labels = indices(own.iter().map(|t| t.token), device);
        let values: Vec<f32> = own.iter().map(|t| t.weight).collect();
        weight += values.iter().map(|&w| f64::from(w)).sum::<f64>();
        let weights = Tensor::<2>::from_data(TensorData::new(values, [own.len(), 1]), device);

        let log_p = log_softmax(scores(class, rows), 1);
        let target = distributions.of_labels(class, labels.clone());
        loss = loss - (log_p.clone() * target * weights.clone()).sum();

        // Metrics only: no gradients needed.
        let log_p = log_p.inner();
        let weights = weights.inner();
        let labels = labels.inner().unsqueeze_dim::<2>(1);
        let likeliest = log_p.clone().argmax(1);
        let hits = likeliest.equal(labels.clone()).float() * weights.clone();
        right += f64::from(hits.sum().into_scalar::<f32>());
        surprise -= f64::from((log_p.gather(1, labels) * weights).sum().into_scalar::<f32>());
    }
    let mut metrics = Sums::new();
    metrics.add("accuracy", right, weight);
    metrics.add("surprise", surprise, weight);
    Output::new(loss, weight, metrics)
}
