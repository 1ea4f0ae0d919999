//! Sizes of numbers in the input.

use burn::tensor::{Tensor, TensorData};

use super::config::VbdConfig;

/// Usual velocities along and across (m/s), lengths, widths and heights of agents (m).
pub(super) const AGENT: [f32; 5] = [10.0, 10.0, 5.0, 2.0, 2.0];
/// Usual coordinates (m) and yaws (rad) of the points of a line.
pub(super) const POINT: [f32; 3] = [10.0, 10.0, 1.0];
/// Usual coordinates of anchors, metres.
pub(super) const ANCHOR: [f32; 2] = [20.0, 20.0];
/// Usual coordinates (m), yaws (rad) and velocities (m/s) of planned states.
pub(super) const STATE: [f32; 5] = [20.0, 20.0, 1.0, 10.0, 10.0];

/// Divides the columns of `[n, columns]` by their usual sizes, if the configuration says so.
pub(super) fn scaled<const N: usize>(x: Tensor<2>, usual: [f32; N], config: &VbdConfig) -> Tensor<2> {
    if !config.scaled {
        return x;
    }
    let usual = Tensor::<2>::from_data(TensorData::new(usual.to_vec(), [1, N]), &x.device());
    x / usual
}
