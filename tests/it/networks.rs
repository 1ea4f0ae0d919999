//! The layers that networks share, and the published next-token network on made-up scenes.

mod attention;
mod naive;
mod smart;
mod weights;

use burn::tensor::{Device, Tensor};

/// Returns the two backends that are compared.
#[expect(deprecated, reason = "kept for comparison")]
pub(crate) fn devices() -> [Device; 2] {
    [Device::flex(), Device::ndarray()]
}

/// Returns the values of a tensor, row by row.
pub(crate) fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
}

/// Returns the largest difference of two lists of one length.
#[track_caller]
pub(crate) fn worst(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    found
        .iter()
        .zip(expected)
        .map(|(a, b)| if a.is_nan() || b.is_nan() { f32::NAN } else { (a - b).abs() })
        .fold(0.0, |worst: f32, d| if d.is_nan() || worst.is_nan() { f32::NAN } else { worst.max(d) })
}
