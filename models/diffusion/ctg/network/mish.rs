//! The activation Mish.

use burn::tensor::Tensor;

/// Number above which exponentials are cut: Mish is the identity there to single precision.
const LARGE: f64 = 20.0;

/// Returns x · tanh(ln(1 + eˣ)), by one exponential: with w = eˣ, the hyperbolic tangent is
/// w (w + 2) / (w (w + 2) + 2).
pub(super) fn mish<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    let w = x.clone().clamp_max(LARGE).exp();
    let n = w.clone() * (w + 2.0);
    x * (n.clone() / (n + 2.0))
}

#[cfg(test)]
mod tests {
    use burn::tensor::activation;
    use reactsim_nn::device;

    use super::*;

    #[test]
    fn values_and_gradients_are_those_of_the_backend() {
        let numbers: Vec<f32> = (-120..=120).map(|k| k as f32 * 0.25).collect();
        let device = device().autodiff();
        let of = |function: fn(Tensor<1>) -> Tensor<1>| {
            let x = Tensor::<1>::from_floats(numbers.as_slice(), &device).require_grad();
            let y = function(x.clone());
            let gradients = y.clone().sum().backward();
            [y, x.grad(&gradients).unwrap()].map(|t| t.into_data().iter::<f32>().collect::<Vec<_>>())
        };
        let ([values, slopes], [expected, expected_slopes]) = (of(mish), of(activation::mish));
        for k in 0..numbers.len() {
            let near = |a: f32, b: f32| (a - b).abs() < 1e-5 * (1.0 + b.abs());
            assert!(near(values[k], expected[k]), "{}: {} {}", numbers[k], values[k], expected[k]);
            assert!(
                near(slopes[k], expected_slopes[k]),
                "{}: {} {}",
                numbers[k],
                slopes[k],
                expected_slopes[k]
            );
        }
    }
}
