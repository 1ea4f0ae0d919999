//! Sine embeddings of positions.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim::geometry::math;

/// Factor from the shortest wavelength, 1 m, up to which wavelengths grow.
const TEMPERATURE: f64 = 10_000.0;

/// Embeds positions by sines of wavelengths from 1 m up (DAB-DETR, <https://arxiv.org/abs/2201.12329>,
/// as MTR uses it): the first half of the numbers is for y, the second for x, with sines and cosines in
/// turn.
///
/// Maps `[n, 2]` to `[n, width]`.
pub(crate) fn sine(positions: Tensor<2>, width: usize) -> Tensor<2> {
    let device: Device = positions.device();
    let half = width / 2;
    // A cosine is a sine a quarter turn later: one product and one sine for all numbers.
    let mut factors = vec![0.0f32; 2 * width];
    let mut phases = vec![0.0f32; width];
    for i in 0..half {
        let scale = std::f64::consts::TAU / math::pow(TEMPERATURE, 2.0 * (i / 2) as f64 / half as f64);
        let phase = if i % 2 == 1 { std::f32::consts::FRAC_PI_2 } else { 0.0 };
        factors[width + i] = scale as f32;
        factors[half + i] = scale as f32;
        phases[i] = phase;
        phases[half + i] = phase;
    }
    let factors = Tensor::<2>::from_data(TensorData::new(factors, [2, width]), &device);
    let phases = Tensor::<2>::from_data(TensorData::new(phases, [1, width]), &device);
    (positions.matmul(factors) + phases).sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedding_follows_the_formula() {
        let at = Tensor::<2>::from_data([[3.25f32, -7.5]], &crate::models::nn::device());
        let found: Vec<f32> = sine(at, 8).into_data().iter::<f32>().collect();
        let wave = |v: f64, i: usize| v * std::f64::consts::TAU / 10_000f64.powf(2.0 * (i / 2) as f64 / 4.0);
        for (base, v) in [(0, -7.5), (4, 3.25)] {
            for i in 0..4 {
                let a = wave(v, i);
                let wanted = if i % 2 == 0 { a.sin() } else { a.cos() };
                assert!((f64::from(found[base + i]) - wanted).abs() < 1e-4, "{base} {i}");
            }
        }
    }
}
