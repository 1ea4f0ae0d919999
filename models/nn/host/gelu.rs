//! The activation GELU of numbers without gradients.

use burn::tensor::Tensor;
use pulp::{Arch, Simd, WithSimd};

use super::Numbers;
use super::softmax::exp;

/// Returns x Φ(x) of each number x, with the distribution function Φ of the standard normal distribution to
/// 1.5e-7 (Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.26).
pub(crate) fn gelu(x: Tensor<2>) -> Tensor<2> {
    let device = x.device();
    let mut data = Numbers::own(x);
    // Networks are loaded and computed in this type.
    Arch::new().dispatch(Gelu(data.as_mut_slice().expect("32-bit floating-point numbers")));
    Tensor::from_data(data, &device)
}

struct Gelu<'a>(&'a mut [f32]);

impl WithSimd for Gelu<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for x in self.0 {
            *x = of(*x);
        }
    }
}

/// It has no branches, so that a processor computes several at once.
#[inline(always)]
fn of(x: f32) -> f32 {
    let size = x.abs();
    let t = 1.0 / (1.0 + 0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2 * size);
    let series = 0.254_829_6 + t * (-0.284_496_74 + t * (1.421_413_7 + t * (-1.453_152 + t * 1.061_405_4)));
    // Beyond the number, on its side.
    let beyond = 0.5 * t * series * exp(-0.5 * x * x);
    let most = if x > 0.0 { x } else { 0.0 };
    most - size * beyond
}

#[cfg(test)]
mod tests {
    use burn::tensor::{TensorData, activation};

    use super::*;
    use crate::device;

    #[test]
    fn values_are_those_of_the_backend() {
        let numbers: Vec<f32> = (-4000..=4000).map(|k| k as f32 * 0.005).collect();
        let x = Tensor::<2>::from_data(TensorData::new(numbers, [1, 8001]), &device());
        let values = |y: Tensor<2>| y.into_data().iter::<f32>().collect::<Vec<_>>();
        let (found, expected) = (values(gelu(x.clone())), values(activation::gelu(x)));
        for (a, b) in found.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()), "{a} {b}");
        }
        assert!(of(f32::NAN).is_nan() && of(0.0) == 0.0);
    }
}
