//! Sine embeddings of positions.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_geometry::math;
use reactsim_nn::{cos_sin_rows, is_host};

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
    let frequency = |i: usize| math::pow(TEMPERATURE, -2.0 * (i / 2) as f64 / half as f64);
    if is_host(&device) {
        let frequencies: Vec<f32> = (0..half).step_by(2).map(|i| frequency(i) as f32).collect();
        return on_host(positions, width, &frequencies);
    }
    // A cosine is a sine a quarter turn later: one product and one sine for all numbers.
    let mut factors = vec![0.0f32; 2 * width];
    let mut phases = vec![0.0f32; width];
    for i in 0..half {
        let scale = (std::f64::consts::TAU * frequency(i)) as f32;
        let phase = if i % 2 == 1 { std::f32::consts::FRAC_PI_2 } else { 0.0 };
        factors[width + i] = scale;
        factors[half + i] = scale;
        phases[i] = phase;
        phases[half + i] = phase;
    }
    let factors = Tensor::<2>::from_data(TensorData::new(factors, [2, width]), &device);
    let phases = Tensor::<2>::from_data(TensorData::new(phases, [1, width]), &device);
    (positions.matmul(factors) + phases).sin()
}

/// Embeds positions by many sines at a time; a backend calls the system's sine for each number.
/// `frequencies` are those of pairs of sine and cosine, in turns per metre.
fn on_host(positions: Tensor<2>, width: usize, frequencies: &[f32]) -> Tensor<2> {
    let (device, rows, half) = (positions.device(), positions.dims()[0], width / 2);
    let mut out = vec![0.0; rows * width];
    let positions: Vec<f32> = positions.into_data().iter::<f32>().collect();
    let (xy, _) = positions.as_chunks::<2>();
    for (axis, first) in [(1, 0), (0, half)] {
        let pairs = cos_sin_rows(xy.iter().map(|p| p[axis]), frequencies);
        for (to, row) in out.chunks_exact_mut(width).zip(pairs.chunks_exact(2 * frequencies.len() + 1)) {
            let (cosines, sines) = row.split_at(frequencies.len());
            let (to, _) = to[first..first + half].as_chunks_mut::<2>();
            to.iter_mut().zip(sines.iter().zip(cosines)).for_each(|(to, (sin, cos))| *to = [*sin, *cos]);
        }
    }
    Tensor::from_data(TensorData::new(out, [rows, width]), &device)
}

#[cfg(test)]
mod tests {
    use reactsim_nn::device;

    use super::*;

    #[test]
    fn the_embedding_follows_the_formula() {
        // One of them with the operations of the backend.
        for device in [device(), device().autodiff()] {
            check(&device);
        }
    }

    fn check(device: &Device) {
        let at = Tensor::<2>::from_data([[3.25f32, -7.5]], device);
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
