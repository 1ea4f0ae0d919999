//! Loss of a policy gradient over tokens.

use burn::tensor::activation::log_softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};
use reactsim_nn::indices;
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
    let in_batch = |(own, first): (&'c Vec<Choice>, usize)| {
        own.iter().map(move |choice| Choice { drawn: choice.drawn.in_batch(first), ..*choice })
    };
    choices.zip(firsts).flat_map(in_batch).collect()
}

/// Returns the negative log-likelihood of drawn tokens, weighted by their advantages, plus `anchor` times the
/// divergence of the scores from those of a reference network (Kullback and Leibler, nats, reference first),
/// which is a metric too, as is the entropy of the scores (nats). Items are the weights of the agents.
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
    let (mut weight, mut divergence, mut entropy) = (0.0, 0.0, 0.0);
    for class in Class::ALL {
        let own: Vec<&Choice> = choices.iter().filter(|c| c.drawn.class == class).collect();
        if own.is_empty() {
            continue;
        }
        let column = |value: fn(&Choice) -> f32| {
            let values: Vec<f32> = own.iter().map(|c| value(c)).collect();
            Tensor::<2>::from_data(TensorData::new(values, [own.len(), 1]), device)
        };
        weight += own.iter().map(|c| f64::from(c.drawn.weight)).sum::<f64>();
        let rows = indices(own.iter().map(|c| c.drawn.row), device);
        let tokens = indices(own.iter().map(|c| c.drawn.token), device).unsqueeze_dim::<2>(1);
        let log_p = log_softmax(scores(class, rows.clone()), 1);
        // A metric only: no gradients needed.
        let plain = log_p.clone().inner();
        let own_entropy = (plain.clone().exp() * plain).sum_dim(1) * column(|c| c.drawn.weight).inner();
        entropy -= f64::from(own_entropy.sum().into_scalar::<f32>());
        let log_q = Tensor::from_inner(log_softmax(reference(class, rows.inner()), 1));
        let apart = (log_q.clone().exp() * (log_q - log_p.clone())).sum_dim(1) * column(|c| c.drawn.weight);
        let apart = apart.sum();
        divergence += f64::from(apart.clone().inner().into_scalar::<f32>());
        let gain = log_p.gather(1, tokens) * column(|c| c.drawn.weight * c.advantage);
        loss = loss + apart * anchor - gain.sum();
    }
    let mut metrics = Sums::new();
    metrics.add("divergence", divergence, weight);
    metrics.add("entropy", entropy, weight);
    Output::new(loss, weight, metrics)
}

#[cfg(test)]
mod tests {
    use reactsim_nn::device;

    use super::*;

    #[test]
    fn divergence_and_entropy_are_means_over_the_tokens() {
        let learning = device().autodiff();
        let choice = |row, weight| {
            let drawn = Target { row, class: Class::Pedestrian, token: 1, weight };
            Choice { drawn, advantage: 2.0 }
        };
        // Probabilities 1/2 and 1/4 of the second token; the reference has 1/2 for both.
        let scores = |_, rows: Tensor<1, Int>| {
            let all = Tensor::<2>::from_data([[0.0, 0.0], [3.0f32.ln(), 0.0]], &rows.device());
            all.select(0, rows)
        };
        let reference = |_, rows: Tensor<1, Int>| Tensor::<2>::zeros([rows.dims()[0], 2], &rows.device());
        let found = policy_loss(&[choice(0, 1.0), choice(1, 3.0)], 0.5, &learning, scores, reference);
        let (ln_2, ln_4) = (2.0f64.ln(), 4.0f64.ln());
        let apart = -0.5 * (0.75f64.ln() + 0.25f64.ln()) - ln_2;
        let near =
            |found: f64, expected: f64| assert!((found - expected).abs() < 1e-5, "{found}, {expected}");
        near(found.items, 4.0);
        near(found.metrics.mean("divergence").unwrap(), 3.0 * apart / 4.0);
        let entropy = ln_2 + 3.0 * (0.25 * ln_4 - 0.75 * 0.75f64.ln());
        near(found.metrics.mean("entropy").unwrap(), entropy / 4.0);
        let loss = f64::from(found.loss.into_scalar::<f32>());
        near(loss, 0.5 * 3.0 * apart + 2.0 * (ln_2 + 3.0 * ln_4));
    }
}
