//! Target distributions of a token loss: the label, smoothed toward tokens that end nearby.

use burn::tensor::{Device, Int, Tensor, TensorData};
use reactsim_nn::perception::Class;
use serde::{Deserialize, Serialize};

use super::tokens::Vocabulary;

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

    /// Returns the distributions of labels of a class, [labels, tokens].
    pub(super) fn of_labels(&self, class: Class, labels: Tensor<1, Int>) -> Tensor<2> {
        self.0[class.index()].clone().select(0, labels)
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
