//! Matrix products with weights, and the norms and activations that follow them.

use burn::nn::{LayerNorm, Linear};
use burn::tensor::activation::{self, relu};
use burn::tensor::module::layer_norm;
use burn::tensor::{Device, Int, Tensor, TensorData};

use super::fused;
use super::host::{self, RowPass, is_host};

/// Constant added to the variances of layer norms, dimensionless; value of the published networks.
const NORM_EPSILON: f64 = 1e-5;

/// Returns a tensor of indices.
pub fn indices(values: impl IntoIterator<Item = usize>, device: &Device) -> Tensor<1, Int> {
    let values: Vec<i32> = values.into_iter().map(|value| value as i32).collect();
    let count = values.len();
    Tensor::from_data(TensorData::new(values, [count]), device)
}

/// A matrix and operations on its rows, which give a matrix `[n, width]`. Without gradients, in host
/// memory, this is one pass; otherwise these are operations of the backend.
///
/// The operations are carried out in the order of the methods below, each at most once but for
/// [`Rows::plus`].
pub struct Rows {
    x: Tensor<2>,
    pass: RowPass,
}

impl Rows {
    /// Begins with a matrix.
    pub fn of(x: Tensor<2>) -> Self {
        Self { x, pass: RowPass::default() }
    }

    /// Begins with the product of a matrix `[n, k]` and weights `[k, width]`.
    pub fn product(x: Tensor<2>, weights: Tensor<2>) -> Self {
        Self { x, pass: RowPass { weights: Some(weights), ..RowPass::default() } }
    }

    /// Begins with the output of a linear layer for a matrix `[n, inputs]`.
    pub fn linear(layer: &Linear, x: Tensor<2>) -> Self {
        let mut rows = Self::product(x, layer.weight.val());
        rows.pass.bias = layer.bias.as_ref().map(|bias| bias.val());
        rows
    }

    /// Adds a matrix of the same shape, or one of fewer rows that is repeated.
    pub fn plus(mut self, other: Tensor<2>) -> Self {
        self.pass.added.push(other);
        self
    }

    /// Applies a layer norm.
    pub fn norm(self, norm: &LayerNorm) -> Self {
        self.normalize(norm.gamma.val(), norm.beta.as_ref().map(|beta| beta.val()))
    }

    /// Normalises rows to zero mean and unit variance, then applies gain and shift, `[width]`.
    pub fn normalize(mut self, gain: Tensor<1>, shift: Option<Tensor<1>>) -> Self {
        self.pass.norm = Some((gain, shift, NORM_EPSILON as f32));
        self
    }

    /// Replaces negative numbers by 0.
    pub fn relu(mut self) -> Self {
        self.pass.relu = true;
        self
    }

    /// Multiplies each row by its factor, `[n, 1]`.
    pub fn times(mut self, factors: Tensor<2>) -> Self {
        self.pass.factors = Some(factors);
        self
    }

    /// Returns the matrix.
    ///
    /// # Panics
    /// If shapes do not fit together.
    pub fn done(self) -> Tensor<2> {
        let Self { x, pass } = self;
        if is_host(&x.device()) {
            return host::pass(x, pass);
        }
        let RowPass { weights, added, bias, norm, relu: rectified, factors } = pass;
        let x = if added.is_empty() {
            learned(x, weights, bias, norm, rectified)
        } else {
            let x = match weights {
                Some(weights) => learned(x, Some(weights), None, None, false),
                None => x,
            };
            let [n, width] = x.dims();
            let x = added.into_iter().fold(x, |x, other| {
                let m = other.dims()[0];
                if m == n {
                    return x + other;
                }
                (x.reshape([n / m, m, width]) + other.unsqueeze_dim::<3>(0)).reshape([n, width])
            });
            learned(x, None, bias, norm, rectified)
        };
        match factors {
            Some(factors) => x * factors,
            None => x,
        }
    }
}

/// Multiplies with weights and finishes, with gradients: as one operation where there is one.
fn learned(
    x: Tensor<2>,
    weights: Option<Tensor<2>>,
    bias: Option<Tensor<1>>,
    norm: Option<(Tensor<1>, Option<Tensor<1>>, f32)>,
    rectified: bool,
) -> Tensor<2> {
    if let Some(x) = fused::finish(&x, weights.as_ref(), bias.as_ref(), norm.as_ref(), rectified) {
        return x;
    }
    let x = match weights {
        Some(weights) => x.matmul(weights),
        None => x,
    };
    finish(x, bias, norm, rectified)
}

/// Adds the bias, applies the norm (gain, shift, constant added to variances) and the activation, by
/// operations of the backend.
pub(super) fn finish(
    mut x: Tensor<2>,
    bias: Option<Tensor<1>>,
    norm: Option<(Tensor<1>, Option<Tensor<1>>, f32)>,
    rectified: bool,
) -> Tensor<2> {
    if let Some(bias) = bias {
        x = x + bias.unsqueeze_dim::<2>(0);
    }
    if let Some((gain, shift, _)) = norm {
        x = layer_norm(x, gain, shift, NORM_EPSILON);
    }
    if rectified { relu(x) } else { x }
}

/// Returns the output of a linear layer, `[n, outputs]`, for a matrix `[n, inputs]`.
pub fn linear(layer: &Linear, x: Tensor<2>) -> Tensor<2> {
    Rows::linear(layer, x).done()
}

/// Returns x Φ(x) of each number x of a matrix, with the distribution function Φ of the standard normal
/// distribution.
pub fn gelu(x: Tensor<2>) -> Tensor<2> {
    if is_host(&x.device()) { host::gelu(x) } else { activation::gelu(x) }
}

/// Returns x · tanh(ln(1 + eˣ)) of each number x, by one exponential: with w = eˣ, the hyperbolic tangent
/// is w (w + 2) / (w (w + 2) + 2).
pub fn mish<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    if is_host(&x.device()) {
        return host::mish(x);
    }
    let w = x.clone().clamp_max(host::MISH_BOUND).exp();
    let n = w.clone() * (w + 2.0);
    x * (n.clone() / (n + 2.0))
}

/// Returns m + σ(g) (o - m) of each logit g of a gate, own number o and message m, with the logistic function
/// σ.
pub(super) fn gated(logits: Tensor<2>, own: Tensor<2>, message: Tensor<2>) -> Tensor<2> {
    if is_host(&logits.device()) {
        return host::gate(logits, own, message);
    }
    message.clone() + activation::sigmoid(logits) * (own - message)
}

/// Normalizes the last axis to zero mean and unit variance, without gain and bias. Relations go
/// through this once, before all layers.
pub fn normalize<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    let dims = x.dims();
    let width = dims[D - 1];
    let ones = Tensor::from_data(TensorData::new(vec![1.0f32; width], [width]), &x.device());
    let rows = dims.iter().product::<usize>() / width.max(1);
    Rows::of(x.reshape([rows, width])).normalize(ones, None).done().reshape(dims)
}

/// Returns the element-wise maximum of `count` blocks of rows of equal height.
///
/// # Panics
/// If the rows cannot be divided into `count` blocks.
pub fn pool(x: Tensor<2>, count: usize) -> Tensor<2> {
    let [rows, width] = x.dims();
    let rows = rows / count;
    if is_host(&x.device()) {
        return host::largest(x.reshape([1, count, rows * width])).reshape([rows, width]);
    }
    let block = |k: usize| x.clone().narrow(0, k * rows, rows);
    (1..count).fold(block(0), |largest, k| largest.max_pair(block(k)))
}

/// Returns the element-wise maximum of the rows of each group, `[n, width]`, of groups `[n, each, width]`.
///
/// # Panics
/// If groups have no rows.
pub fn largest(groups: Tensor<3>) -> Tensor<2> {
    if is_host(&groups.device()) { host::largest(groups) } else { groups.max_dim(1).squeeze_dim(1) }
}

/// Gathers places of each of `n` sequences, `[n, places, width]`, into `[n * index, width]`; places that are
/// `None` are 0.
///
/// # Panics
/// If there are fewer places.
pub fn gather(x: Tensor<3>, index: &[Option<usize>]) -> Tensor<2> {
    let device = x.device();
    if is_host(&device) {
        return host::gather(x, index);
    }
    let [n, places, width] = x.dims();
    let zero = n * places;
    let rows = (0..n).flat_map(|i| index.iter().map(move |at| at.map_or(zero, |at| i * places + at)));
    let with_zero = Tensor::cat(vec![x.reshape([zero, width]), Tensor::zeros([1, width], &device)], 0);
    with_zero.select(0, indices(rows, &device))
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, Distribution};

    use super::*;
    use crate::device;

    fn numbers<const D: usize>(x: Tensor<D>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    /// Runs the same on the host and with the operations of the backend.
    fn check(work: impl Fn(&Device) -> Tensor<2>) {
        let (host, backend) = (numbers(work(&device())), numbers(work(&device().autodiff())));
        assert_eq!(host.len(), backend.len());
        for (a, b) in host.iter().zip(&backend) {
            assert!((a - b).abs() <= 2e-5 * b.abs().max(1.0), "{a} {b}");
        }
    }

    fn made<const D: usize>(shape: [usize; D], device: &Device) -> Tensor<D> {
        let count = shape.iter().product::<usize>();
        let values: Vec<f32> = (0..count).map(|i| ((i * 7919 + 13) % 1009) as f32 / 300.0 - 1.5).collect();
        Tensor::from_data(TensorData::new(values, shape), device)
    }

    #[test]
    fn one_pass_equals_the_operations() {
        for (rows, width) in [(12, 1), (6, 16), (24, 64), (3, 37), (0, 8)] {
            check(|device| {
                let m = rows / 3;
                Rows::of(made([rows, width], device))
                    .plus(made([m, width], device))
                    .normalize(made([width], device), Some(made([width], device)))
                    .relu()
                    .times(made([rows, 1], device))
                    .done()
            });
            check(|device| {
                Rows::of(made([rows, width], device)).plus(made([rows.max(1), width], device)).done()
            });
            check(|device| normalize(made([rows, width], device)));
        }
    }

    #[test]
    fn products_equal_those_of_the_backend() {
        for (rows, k, width) in
            [(1, 1, 1), (100, 18, 32), (49, 64, 112), (31, 33, 50), (3, 129, 128), (0, 4, 4)]
        {
            check(|device| {
                Rows::product(made([rows, k], device), made([k, width], device))
                    .plus(made([rows.max(1), width], device))
                    .relu()
                    .done()
            });
        }
    }

    #[test]
    fn a_row_of_a_product_depends_on_this_row_alone() {
        let device = device();
        let (x, weights) = (made([200, 37], &device), made([37, 70], &device));
        let all = numbers(Rows::product(x.clone(), weights.clone()).done());
        for rows in [1, 5, 31, 32, 77] {
            let some = Rows::product(x.clone().narrow(0, 3, rows), weights.clone()).done();
            assert_eq!(numbers(some), all[3 * 70..(3 + rows) * 70]);
        }
    }

    #[test]
    fn blocks_are_pooled() {
        check(|device| pool(made([20, 7], device), 5));
        check(|device| pool(made([20, 32], device), 1));
        check(|device| largest(made([6, 5, 17], device)));
        let x = Tensor::<2>::from_data([[1.0f32], [f32::NAN], [2.0]], &device());
        assert!(numbers(pool(x, 3))[0].is_nan());
    }

    #[test]
    fn places_are_gathered() {
        check(|device| gather(made([3, 4, 5], device), &[Some(1), None, Some(3), Some(1)]));
    }

    #[test]
    fn shared_tensors_are_not_changed() {
        let x = Tensor::<2>::random([4, 16], Distribution::Uniform(-1.0, 1.0), &device());
        let before = numbers(x.clone());
        let _ = Rows::of(x.clone()).relu().done();
        assert_eq!(numbers(x), before);
    }

    #[test]
    fn not_a_number_remains() {
        let x = Tensor::<2>::from_data([[f32::NAN, -1.0, 2.0]], &device());
        let found = numbers(Rows::of(x).relu().done());
        assert!(found[0].is_nan());
        assert_eq!(found[1..], [0.0, 2.0]);
    }

    #[test]
    fn mish_and_its_gradients_are_those_of_the_backend() {
        let values: Vec<f32> = (-1200..=1200).map(|k| k as f32 * 0.025).collect();
        let device = device().autodiff();
        let of = |function: fn(Tensor<1>) -> Tensor<1>| {
            let x = Tensor::<1>::from_floats(values.as_slice(), &device).require_grad();
            let y = function(x.clone());
            let gradients = y.clone().sum().backward();
            [numbers(y), numbers(x.grad(&gradients).unwrap())]
        };
        let [expected, slopes] = of(activation::mish);
        let [with_gradients, own_slopes] = of(mish);
        let on_host = numbers(mish(Tensor::<1>::from_floats(values.as_slice(), &super::super::device())));
        let all = with_gradients.iter().zip(&expected).chain(on_host.iter().zip(&expected));
        for (a, b) in all.chain(own_slopes.iter().zip(&slopes)) {
            assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "{a} {b}");
        }
        assert!(numbers(mish(Tensor::<1>::from_floats([f32::NAN], &super::super::device())))[0].is_nan());
    }
}
