//! Encoder of images.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::Tensor;
use reactsim_nn::{Initializer, Rows};

use super::config::CtgConfig;
use super::convolution::HalvingStage;
use crate::ctg::Sight;

/// Four convolutions that halve the image, and a linear layer that reads what is left of it.
///
/// The public code averages the last image (ResNet-18); here each of its places is read, so that few features
/// say where something is.
#[derive(Module, Debug)]
pub(super) struct RasterEncoder {
    stages: Vec<HalvingStage>,
    output: Linear,
    norm: LayerNorm,
}

impl RasterEncoder {
    pub(super) fn init(config: &CtgConfig, sight: &Sight, init: &mut Initializer) -> Self {
        let mut inputs = sight.channels();
        let mut stage = |width: usize| {
            let stage = HalvingStage::init(inputs, width, init);
            inputs = width;
            stage
        };
        let stages: Vec<_> = [1, 2, 4, 6].map(|times| stage(times * config.image_width)).into();
        let left = sight.pixels >> stages.len();
        let output = init.linear(left * left * inputs, config.features, true);
        Self { stages, output, norm: init.norm(config.features) }
    }

    /// Maps images `[n, pixels, pixels, channels]` to `[n, features]`.
    pub(super) fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let n = images.dims()[0];
        let last = self.stages.iter().fold(images, |x, stage| stage.forward(x));
        let width = last.dims()[1..].iter().product();
        Rows::linear(&self.output, last.reshape([n, width])).norm(&self.norm).relu().done()
    }
}
