//! Convolutions as products of rows: every output is a linear function of its neighbourhood, which is
//! gathered into one row. Training takes half as long as with the backend's convolutions.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Rows, gather};

/// A convolution of images by 3 by 3 pixels with stride 2, with a layer norm over channels and ReLU.
#[derive(Module, Debug)]
pub(super) struct HalvingStage {
    kernel: Linear,
    norm: LayerNorm,
}

impl HalvingStage {
    pub(super) fn init(inputs: usize, outputs: usize, init: &mut Initializer) -> Self {
        Self { kernel: init.linear(9 * inputs, outputs, false), norm: init.norm(outputs) }
    }

    /// Maps `[n, 2 size, 2 size, inputs]` to `[n, size, size, outputs]`.
    pub(super) fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let [n, height, width, inputs] = x.dims();
        let (rows, columns) = (height / 2, width / 2);
        let around = |at: usize, by: usize, size: usize| (2 * at + by).checked_sub(1).filter(|i| *i < size);
        let mut index = Vec::with_capacity(rows * columns * 9);
        for row in 0..rows {
            for column in 0..columns {
                for by in 0..9 {
                    let pixel = around(row, by / 3, height).zip(around(column, by % 3, width));
                    index.push(pixel.map(|(row, column)| row * width + column));
                }
            }
        }
        let gathered = gather(x.reshape([n, height * width, inputs]), &index);
        let gathered = gathered.reshape([n * rows * columns, 9 * inputs]);
        let out = Rows::linear(&self.kernel, gathered).norm(&self.norm).relu().done();
        let outputs = out.dims()[1];
        out.reshape([n, rows, columns, outputs])
    }
}

/// A convolution of sequences with an odd number of taps.
#[derive(Module, Debug)]
pub(super) struct Convolution {
    kernel: Linear,
}

impl Convolution {
    pub(super) fn init(taps: usize, inputs: usize, outputs: usize, init: &mut Initializer) -> Self {
        Self { kernel: init.linear(taps * inputs, outputs, true) }
    }

    /// Maps `[n, steps, inputs]` to rows `[n * steps / stride, outputs]` that can go on with a norm.
    pub(super) fn rows(&self, x: Tensor<3>, stride: usize) -> Rows {
        let [n, steps, inputs] = x.dims();
        let taps = self.kernel.weight.dims()[0] / inputs;
        let around = |at: usize, by: usize| (at * stride + by).checked_sub(taps / 2).filter(|i| *i < steps);
        let count = steps / stride;
        let index: Vec<Option<usize>> = (0..count * taps).map(|i| around(i / taps, i % taps)).collect();
        Rows::linear(&self.kernel, gather(x, &index).reshape([n * count, taps * inputs]))
    }

    /// Maps `[n, steps, inputs]` to `[n, steps / stride, outputs]`.
    pub(super) fn forward(&self, x: Tensor<3>, stride: usize) -> Tensor<3> {
        let [n, steps, _] = x.dims();
        let out = self.rows(x, stride).done();
        let outputs = out.dims()[1];
        out.reshape([n, steps / stride, outputs])
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Distribution;
    use burn::tensor::module::{conv1d, conv2d};
    use burn::tensor::ops::ConvOptions;
    use reactsim_nn::device;

    use super::*;

    fn values<const D: usize>(x: Tensor<D>) -> Vec<f32> {
        x.into_data().iter::<f32>().collect()
    }

    fn assert_near<const D: usize>(found: Tensor<D>, expected: Tensor<D>) {
        assert_eq!(found.dims(), expected.dims());
        for (found, expected) in values(found).into_iter().zip(values(expected)) {
            assert!((found - expected).abs() < 1e-4, "{found} {expected}");
        }
    }

    #[test]
    fn sequences_are_convolved_as_by_the_backend() {
        let device = device();
        for (taps, stride) in [(5, 1), (3, 2), (1, 1)] {
            let convolution = Convolution::init(taps, 3, 4, &mut Initializer::new(1, &device));
            let x = Tensor::<3>::random([2, 8, 3], Distribution::Default, &device);
            let kernel = convolution.kernel.weight.val().reshape([taps, 3, 4]).permute([2, 1, 0]);
            let options = ConvOptions::new([stride], [taps / 2], [1], 1);
            let expected = conv1d(x.clone().swap_dims(1, 2), kernel, None, options).swap_dims(1, 2);
            assert_near(convolution.forward(x, stride), expected);
        }
    }

    #[test]
    fn images_are_convolved_as_by_the_backend() {
        let device = device();
        let stage = HalvingStage::init(3, 4, &mut Initializer::new(1, &device));
        let x = Tensor::<4>::random([2, 6, 6, 3], Distribution::Default, &device);
        let kernel = stage.kernel.weight.val().reshape([3, 3, 3, 4]).permute([3, 2, 0, 1]);
        let options = ConvOptions::new([2, 2], [1, 1], [1, 1], 1);
        let expected = conv2d(x.clone().permute([0, 3, 1, 2]), kernel, None, options).permute([0, 2, 3, 1]);
        let rows = expected.reshape([2 * 9, 4]);
        let expected = Rows::of(rows).norm(&stage.norm).relu().done().reshape([2, 3, 3, 4]);
        assert_near(stage.forward(x), expected);
    }
}
