//! Perceptrons as in the public code, with its tensor names (`models/nn/weights/names.rs`).

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::{Tensor, TensorData};
use reactsim_nn::training::{Average, Observation};
use reactsim_nn::{Initializer, Rows};

use super::config::Norms;

/// Constant added to the variances of batch norms.
const EPSILON: f64 = 1e-5;
/// Factor on the initial weights of the third layer of a perceptron, which is that of a head: the
/// reference motion is better than an untrained output.
const HEAD_INIT_SCALE: f64 = 0.1;

/// Means and variances that batch norms observe of their rows, by which they then normalise; `None` for the running
/// ones.
pub(crate) type Observed = Option<Vec<Observation>>;

/// Batch norm or layer norm.
#[derive(Module, Debug)]
pub(crate) struct Norm {
    weight: Param<Tensor<1>>,
    bias: Param<Tensor<1>>,
    running_mean: Option<Average>,
    running_var: Option<Average>,
}

impl Norm {
    fn init(norms: Norms, width: usize, init: &Initializer) -> Self {
        let filled =
            |value: f32| Tensor::from_data(TensorData::new(vec![value; width], [width]), init.device());
        let running = |value: f32| (norms == Norms::Batch).then(|| Average::new(filled(value)));
        Self {
            weight: Param::from_tensor(filled(1.0)),
            bias: Param::from_tensor(filled(0.0)),
            running_mean: running(0.0),
            running_var: running(1.0),
        }
    }

    /// Normalises rows, then applies ReLU. Batch norms in training observe rows by their weights, `[n, 1]`,
    /// all alike without these.
    fn forward(&self, x: Rows, weights: Option<&Tensor<2>>, observed: &mut Observed) -> Rows {
        let (gain, bias) = (self.weight.val(), self.bias.val());
        let (Some(running_mean), Some(running_variance)) = (&self.running_mean, &self.running_var) else {
            return x.normalize(gain, Some(bias)).relu();
        };
        let x = x.done();
        let (mean, variance) = match observed {
            Some(observed) => {
                let (mean, variance, unbiased) = moments(&x, weights);
                observed.push(running_mean.observe(mean.clone()));
                observed.push(running_variance.observe(variance.clone() * unbiased));
                (mean, variance)
            }
            None => (running_mean.val(), running_variance.val()),
        };
        let gain = gain / (variance + EPSILON).sqrt();
        let shift = bias - mean * gain.clone();
        Rows::of(x * gain.unsqueeze_dim::<2>(0) + shift.unsqueeze_dim::<2>(0)).relu()
    }
}

/// Returns the mean and the variance of each column over rows with weights, `[n, 1]`, and the factor that
/// makes the variance an unbiased estimate.
fn moments(x: &Tensor<2>, weights: Option<&Tensor<2>>) -> (Tensor<1>, Tensor<1>, f64) {
    let count = match weights {
        None => x.dims()[0] as f64,
        Some(weights) => f64::from(weights.clone().sum().into_scalar::<f32>()),
    };
    let weighted = |x: Tensor<2>| match weights {
        None => x,
        Some(weights) => x * weights.clone(),
    };
    let sum = |x: Tensor<2>| weighted(x).sum_dim(0).squeeze_dim::<1>(0);
    let count = count.max(1.0);
    let mean = sum(x.clone()) / count;
    let away = x.clone() - mean.clone().unsqueeze_dim::<2>(0);
    let variance = sum(away.clone() * away) / count;
    (mean, variance, count / (count - 1.0).max(1.0))
}

/// One to three linear layers. Hidden layers have a norm instead of a bias, then ReLU.
#[derive(Module, Debug)]
pub(crate) struct NormedMlp {
    first: Linear,
    first_norm: Option<Norm>,
    second: Option<Linear>,
    second_norm: Option<Norm>,
    third: Option<Linear>,
    third_norm: Option<Norm>,
}

impl NormedMlp {
    /// Creates a perceptron from `inputs` numbers with these widths. With `open` the last layer is
    /// linear with a bias; otherwise it is like the others.
    pub(crate) fn init(
        inputs: usize,
        widths: &[usize],
        open: bool,
        norms: Norms,
        init: &mut Initializer,
    ) -> Self {
        let mut last = inputs;
        let mut layers = widths.iter().enumerate().map(|(i, &width)| {
            let hidden = !open || i + 1 < widths.len();
            let mut linear = init.linear(last, width, !hidden);
            if !hidden && i == 2 {
                linear.weight =
                    init.uniform([last, width], HEAD_INIT_SCALE * (6.0 / (last + width) as f64).sqrt());
            }
            last = width;
            (linear, hidden.then(|| Norm::init(norms, width, init)))
        });
        let [first, second, third] = std::array::from_fn(|_| layers.next());
        let Some((first, first_norm)) = first else { unreachable!("every perceptron has a layer") };
        let (second, second_norm) = second.map_or((None, None), |(l, n)| (Some(l), n));
        let (third, third_norm) = third.map_or((None, None), |(l, n)| (Some(l), n));
        Self { first, first_norm, second, second_norm, third, third_norm }
    }

    /// Maps `[n, inputs]` to `[n, last width]`. Batch norms in training observe rows by their weights, `[n,
    /// 1]`.
    pub(crate) fn forward(
        &self,
        x: Tensor<2>,
        weights: Option<&Tensor<2>>,
        observed: &mut Observed,
    ) -> Tensor<2> {
        self.rows(x, weights, observed).done()
    }

    /// Like [`NormedMlp::forward`], for callers that go on with the rows.
    pub(crate) fn rows(&self, x: Tensor<2>, weights: Option<&Tensor<2>>, observed: &mut Observed) -> Rows {
        self.after_first(Rows::linear(&self.first, x), weights, observed)
    }

    /// Applies everything after the first linear layer, for callers that compute that layer themselves.
    pub(crate) fn after_first(&self, x: Rows, weights: Option<&Tensor<2>>, observed: &mut Observed) -> Rows {
        let mut normed = |norm: &Option<Norm>, x| match norm {
            Some(norm) => norm.forward(x, weights, observed),
            None => x,
        };
        let mut x = normed(&self.first_norm, x);
        for (linear, norm) in [(&self.second, &self.second_norm), (&self.third, &self.third_norm)] {
            if let Some(linear) = linear {
                x = normed(norm, Rows::linear(linear, x.done()));
            }
        }
        x
    }

    /// Returns the weights of the first layer, `[inputs, width]`.
    pub(crate) fn first_weight(&self) -> Tensor<2> {
        self.first.weight.val()
    }
}

#[cfg(test)]
mod tests {
    use reactsim_nn::device;

    use super::*;

    fn matrix(values: &[f32], columns: usize) -> Tensor<2> {
        let data = TensorData::new(values.to_vec(), [values.len() / columns, columns]);
        Tensor::from_data(data, &device())
    }

    fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
        tensor.into_data().iter::<f32>().collect()
    }

    #[test]
    fn moments_are_those_of_the_rows_that_count() {
        let x = matrix(&[1.0, 10.0, 99.0, 99.0, 3.0, 10.0, 5.0, 40.0], 2);
        let (mean, variance, unbiased) = moments(&x, Some(&matrix(&[1.0, 0.0, 1.0, 1.0], 1)));
        assert_eq!(numbers(mean), [3.0, 20.0]);
        assert_eq!(numbers(variance), [8.0 / 3.0, 200.0]);
        assert_eq!(unbiased, 1.5);
        let rows = matrix(&[1.0, 10.0, 3.0, 10.0, 5.0, 40.0], 2);
        assert_eq!(numbers(moments(&rows, None).1), [8.0 / 3.0, 200.0]);
        // Nothing counts: zeros, not NaN.
        let (mean, variance, unbiased) = moments(&x, Some(&matrix(&[0.0; 4], 1)));
        assert_eq!((numbers(mean), numbers(variance), unbiased), (vec![0.0; 2], vec![0.0; 2], 1.0));
    }

    #[test]
    fn batch_norm_normalises_by_the_batch_in_training_and_by_running_values_otherwise() {
        let norm = Norm::init(Norms::Batch, 1, &Initializer::new(0, &device()));
        let x = || Rows::of(matrix(&[2.0, 4.0, 6.0], 1));
        let trained = numbers(norm.forward(x(), None, &mut Some(Vec::new())).done());
        let wanted = 2.0 / (8.0f32 / 3.0 + 1e-5).sqrt();
        assert!((trained[2] - wanted).abs() < 1e-6 && trained[..2] == [0.0, 0.0], "{trained:?}");
        let run = numbers(norm.forward(x(), None, &mut None).done());
        assert!((run[2] - 6.0).abs() < 1e-4, "{run:?}");
    }
}
