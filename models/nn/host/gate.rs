//! The gate of attention layers, for numbers without gradients.

use burn::tensor::Tensor;
use pulp::{Arch, Simd, WithSimd};

use super::Numbers;
use super::softmax::exp;

/// Returns m + σ(g) (o - m) of each logit g of a gate, own number o and message m, with the logistic function
/// σ to 3e-7.
///
/// # Panics
/// If the matrices are not of the same shape.
pub(crate) fn gate(logits: Tensor<2>, own: Tensor<2>, message: Tensor<2>) -> Tensor<2> {
    assert!(logits.dims() == own.dims() && own.dims() == message.dims(), "matrices of one shape");
    let device = logits.device();
    let mut out = Numbers::own(logits);
    let (own, message) = (Numbers::of(own), Numbers::of(message));
    // Networks are loaded and computed in this type.
    let numbers = out.as_mut_slice().expect("32-bit floating-point numbers");
    Arch::new().dispatch(Gate { out: numbers, own: own.slice(), message: message.slice() });
    Tensor::from_data(out, &device)
}

struct Gate<'a> {
    /// Logits, then results.
    out: &'a mut [f32],
    own: &'a [f32],
    message: &'a [f32],
}

impl WithSimd for Gate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { out, own, message } = self;
        let (own, message) = (&own[..out.len()], &message[..out.len()]);
        for i in 0..out.len() {
            out[i] = message[i] + logistic(out[i]) * (own[i] - message[i]);
        }
    }
}

/// It has no branches, so that a processor computes several at once.
#[inline(always)]
fn logistic(x: f32) -> f32 {
    let small = exp(-x.abs());
    let share = 1.0 / (1.0 + small);
    if x < 0.0 { small * share } else { share }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{TensorData, activation};

    use super::*;
    use crate::device;

    #[test]
    fn values_are_those_of_the_backend() {
        let made = |factor: f32| {
            let numbers: Vec<f32> = (-4000..=4000).map(|k| k as f32 * factor).collect();
            Tensor::<2>::from_data(TensorData::new(numbers, [3, 2667]), &device())
        };
        let (logits, own, message) = (made(0.03), made(0.001), made(-0.002));
        let values = |y: Tensor<2>| y.into_data().iter::<f32>().collect::<Vec<_>>();
        let expected =
            message.clone() + activation::sigmoid(logits.clone()) * (own.clone() - message.clone());
        for (a, b) in values(gate(logits, own, message)).iter().zip(&values(expected)) {
            assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()), "{a} {b}");
        }
        assert!(logistic(f32::NAN).is_nan());
        assert_eq!((logistic(0.0), logistic(200.0), logistic(-200.0)), (0.5, 1.0, 0.0));
    }
}
