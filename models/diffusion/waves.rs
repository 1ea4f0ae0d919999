//! Waves of a noise level or a time.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_geometry::math;

/// Longest wavelength, divided by 2π.
const LONGEST: f64 = 1e4;

/// Returns `count` cosines of a number, then as many sines, `[1, 2 * count]`.
pub(crate) fn waves(number: f64, count: usize, device: &Device) -> Tensor<2> {
    let phases = (0..count).map(|i| number * math::exp(-math::ln(LONGEST) * i as f64 / count as f64));
    let waves = phases.clone().map(math::cos).chain(phases.map(math::sin));
    let waves: Vec<f32> = waves.map(|wave| wave as f32).collect();
    Tensor::from_data(TensorData::new(waves, [1, 2 * count]), device)
}
