//! Standard normal noise.

use burn::tensor::{Device, Tensor, TensorData};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use reactsim_geometry::math;

/// Draws standard normal numbers from a stream.
pub fn standard_normal<const D: usize>(
    stream: &mut ChaCha8Rng,
    shape: [usize; D],
    device: &Device,
) -> Tensor<D> {
    Tensor::from_data(TensorData::new(normal_values(stream, shape.iter().product()), shape), device)
}

/// Draws this many standard normal numbers from a stream.
pub fn normal_values(stream: &mut ChaCha8Rng, count: usize) -> Vec<f32> {
    (0..count).map(|_| math::standard_normal(1.0 - stream.random::<f64>(), stream.random()) as f32).collect()
}
