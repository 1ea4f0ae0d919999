//! Hooks that change a sample on its way.

use burn::tensor::Tensor;

/// A moment of sampling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Step that was left.
    pub step: usize,
    /// Standard deviation of the noise that is added to the mean; 0 if none is.
    pub deviation: f64,
}

/// Changes the mean of the next, less noisy sample, before noise is added to it: gradient steps on a reward,
/// or values that are known.
pub trait Guide<const D: usize> {
    /// Returns the changed mean.
    ///
    /// `mean` is of the next sample; `clean` is the network's answer, of the same shape.
    fn guide(&mut self, mean: Tensor<D>, clean: &Tensor<D>, moment: Moment) -> Tensor<D>;
}

/// No guidance.
impl<const D: usize> Guide<D> for () {
    fn guide(&mut self, mean: Tensor<D>, _: &Tensor<D>, _: Moment) -> Tensor<D> {
        mean
    }
}
