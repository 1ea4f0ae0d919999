//! Perceptrons as in the public code, with its tensor names (`models/nn/weights/names.rs`).

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::{Tensor, TensorData};

use super::config::Norms;
use crate::models::nn::{Initializer, Rows};

/// Constant added to the variances of batch norms.
const EPSILON: f64 = 1e-5;
/// Factor on the initial weights of the third layer of a perceptron, which is that of a head: the
/// reference motion is better than an untrained output.
const HEAD_INIT_SCALE: f64 = 0.1;

/// Batch norm with fixed statistics, or layer norm.
#[derive(Module, Debug)]
pub(crate) struct Norm {
    weight: Param<Tensor<1>>,
    bias: Param<Tensor<1>>,
    running_mean: Option<Param<Tensor<1>>>,
    running_var: Option<Param<Tensor<1>>>,
}

impl Norm {
    fn init(norms: Norms, width: usize, init: &Initializer) -> Self {
        let filled = |value: f32| -> Param<Tensor<1>> {
            Param::from_data(TensorData::new(vec![value; width], [width]), init.device())
        };
        let fixed = |value: f32| (norms == Norms::Batch).then(|| filled(value).set_require_grad(false));
        Self { weight: filled(1.0), bias: filled(0.0), running_mean: fixed(0.0), running_var: fixed(1.0) }
    }

    /// Normalises rows, then applies ReLU.
    fn forward(&self, x: Rows) -> Rows {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        match (&self.running_mean, &self.running_var) {
            (Some(mean), Some(variance)) => {
                let gain = weight / (variance.val() + EPSILON).sqrt();
                let shift = bias - mean.val() * gain.clone();
                let x = x.done() * gain.unsqueeze_dim::<2>(0) + shift.unsqueeze_dim::<2>(0);
                Rows::of(x).relu()
            }
            _ => x.normalize(weight, Some(bias)).relu(),
        }
    }
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

    /// Maps `[n, inputs]` to `[n, last width]`.
    pub(crate) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        self.rows(x).done()
    }

    /// Like [`NormedMlp::forward`], for callers that go on with the rows.
    pub(crate) fn rows(&self, x: Tensor<2>) -> Rows {
        self.after_first(Rows::linear(&self.first, x))
    }

    /// Applies everything after the first linear layer, for callers that compute that layer themselves.
    pub(crate) fn after_first(&self, x: Rows) -> Rows {
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

fn normed(norm: &Option<Norm>, x: Rows) -> Rows {
    match norm {
        Some(norm) => norm.forward(x),
        None => x,
    }
}

/// Two or three linear layers with biases, with ReLU between them.
#[derive(Module, Debug)]
pub(crate) struct PlainMlp {
    first: Linear,
    second: Linear,
    third: Option<Linear>,
}

impl PlainMlp {
    /// Creates two layers.
    pub(crate) fn two(inputs: usize, widths: [usize; 2], init: &mut Initializer) -> Self {
        let first = init.linear(inputs, widths[0], true);
        Self { first, second: init.linear(widths[0], widths[1], true), third: None }
    }

    /// Creates three layers.
    pub(crate) fn three(inputs: usize, widths: [usize; 3], init: &mut Initializer) -> Self {
        let two = Self::two(inputs, [widths[0], widths[1]], init);
        Self { third: Some(init.linear(widths[1], widths[2], true)), ..two }
    }

    /// Maps `[n, inputs]` to `[n, last width]`.
    pub(crate) fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let x = Rows::linear(&self.second, Rows::linear(&self.first, x).relu().done());
        match &self.third {
            Some(third) => Rows::linear(third, x.relu().done()).done(),
            None => x.done(),
        }
    }
}
