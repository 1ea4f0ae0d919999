//! Standard normal noise.

use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use reactsim::geometry::math;

/// Draws standard normal numbers from a stream (Box and Muller).
pub fn standard_normal<const D: usize>(
    stream: &mut ChaCha8Rng,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    let mut draw = |_| {
        let (u, v): (f64, f64) = (1.0 - stream.random::<f64>(), stream.random());
        ((-2.0 * math::ln(u)).sqrt() * math::cos(std::f64::consts::TAU * v)) as f32
    };
    let values: Vec<f32> = (0..shape.iter().product()).map(&mut draw).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}
