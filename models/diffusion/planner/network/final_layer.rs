//! The output layer.

use burn::module::Module;
use burn::nn::{LayerNorm, Linear};
use burn::tensor::Tensor;
use burn::tensor::activation::{gelu_approximate, silu};
use reactsim_nn::{Initializer, Rows, linear};

use super::PlannerConfig;

/// Norm, linear, approximate GELU, norm, linear.
#[derive(Module, Debug)]
struct FinalProjection {
    first_norm: LayerNorm,
    wide: Linear,
    second_norm: LayerNorm,
    narrow: Linear,
}

/// A modulated norm, then the projection to trajectories.
#[derive(Module, Debug)]
pub(super) struct FinalLayer {
    norm_final: LayerNorm,
    modulation: Linear,
    proj: FinalProjection,
}

impl FinalLayer {
    pub(super) fn init(config: &PlannerConfig, init: &mut Initializer) -> Self {
        let d = config.width;
        Self {
            norm_final: init.norm(d),
            modulation: init.linear(d, 2 * d, true),
            proj: FinalProjection {
                first_norm: init.norm(d),
                wide: init.linear(d, 4 * d, true),
                second_norm: init.norm(4 * d),
                narrow: init.linear(4 * d, config.trajectory(), true),
            },
        }
    }

    /// Maps `[n, width]` to trajectories, on the condition `[1, width]`.
    pub(super) fn forward(&self, x: Tensor<2>, condition: &Tensor<2>) -> Tensor<2> {
        let width = x.dims()[1];
        let changes = linear(&self.modulation, silu(condition.clone()));
        let x = modulated(Rows::of(x).norm(&self.norm_final).done(), &changes, 0, width);
        let FinalProjection { first_norm, wide, second_norm, narrow } = &self.proj;
        let x = gelu_approximate(linear(wide, Rows::of(x).norm(first_norm).done()));
        linear(narrow, Rows::of(x).norm(second_norm).done())
    }
}

/// Scales and shifts rows by parts of `changes`, `[1, parts * width]`: the shift is part `from`, the scale
/// the next.
pub(super) fn modulated(x: Tensor<2>, changes: &Tensor<2>, from: usize, width: usize) -> Tensor<2> {
    let part = |k: usize| changes.clone().narrow(1, k * width, width);
    x * (part(from + 1) + 1.0) + part(from)
}
