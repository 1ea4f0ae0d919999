//! Loss of a policy gradient over tokens.

use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};
use reactsim_nn::perception::Class;
use reactsim_nn::training::{Output, Sums};

use super::token_loss::Target;

/// A token that was drawn, and how much better its agent fared than expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Choice {
    /// Node, class and token; the weight is that of the agent.
    pub drawn: Target,
    /// Return less its baseline.
    pub advantage: f32,
}

/// Returns all choices of a batch of samples, of which the first nodes are in these rows.
pub(crate) fn in_batch<'c>(
    choices: impl Iterator<Item = &'c Vec<Choice>>,
    firsts: impl Iterator<Item = usize>,
) -> Vec<Choice> {
    let shifted = |(own, first): (&Vec<Choice>, usize)| {
        let shifted = |c: &Choice| Choice { drawn: Target { row: c.drawn.row + first, ..c.drawn }, ..*c };
        own.iter().map(shifted).collect::<Vec<_>>()
    };
    choices.zip(firsts).flat_map(shifted).collect()
}

/// Returns the negative log-likelihood of drawn tokens, weighted by their advantages, plus `anchor` times the
/// divergence of the scores from those of a reference network (Kullback and Leibler, nats, reference first),
/// which is a metric too. Items are the weights of the agents.
///
/// `scores` returns the scores of the given rows of nodes of a class, [rows, tokens of the class], with
/// gradients; `reference` those of the reference, without.
pub(crate) fn policy_loss(
    choices: &[Choice],
    anchor: f64,
    device: &Device,
    scores: impl Fn(Class, Tensor<1, Int>) -> Tensor<2>,
    reference: impl Fn(Class, Tensor<1, Int>) -> Tensor<2>,
) -> Output {
    let mut loss = Tensor::zeros([1], device);
    let (mut weight, mut divergence) = (0.0, 0.0);
    for class in Class::ALL {
        let own: Vec<&Choice> = choices.iter().filter(|c| c.drawn.class == class).collect();
        if own.is_empty() {
            continue;
        }
        let ints = |values: Vec<i32>| {
            let n = values.len();
            Tensor::<1, Int>::from_data(TensorData::new(values, [n]), device)
        };
        let column = |value: fn(&Choice) -> f32| {
            let values: Vec<f32> = own.iter().map(|c| value(c)).collect();
            Tensor::<2>::from_data(TensorData::new(values, [own.len(), 1]), device)
        };
        weight += own.iter().map(|c| f64::from(c.drawn.weight)).sum::<f64>();
        let rows = ints(own.iter().map(|c| c.drawn.row as i32).collect());
        let tokens = ints(own.iter().map(|c| c.drawn.token as i32).collect()).unsqueeze_dim::<2>(1);
        let log_p = log_softmax(scores(class, rows.clone()), 1);
        let log_q = Tensor::from_inner(log_softmax(reference(class, rows.inner()), 1));
        let apart = (log_q.clone().exp() * (log_q - log_p.clone())).sum_dim(1) * column(|c| c.drawn.weight);
        let apart = apart.sum();
        divergence += f64::from(apart.clone().inner().into_scalar::<f32>());
        let gain = log_p.gather(1, tokens) * column(|c| c.drawn.weight * c.advantage);
        loss = loss + apart * anchor - gain.sum();
    }
    let mut metrics = Sums::new();
    metrics.add("divergence", divergence, weight);
    Output::new(loss, weight, metrics)
}
