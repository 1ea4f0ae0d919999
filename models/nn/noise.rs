//! Dropout from a named stream.

use burn::tensor::{Tensor, TensorData};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;

/// Where dropout takes its numbers from: nowhere when a network is used, a stream of the caller's when it is trained. So a training step
/// can be repeated to the bit.
#[derive(Debug, Default)]
pub struct Noise {
    stream: Option<ChaCha8Rng>,
}

impl Noise {
    /// Drops nothing.
    pub fn none() -> Self {
        Self::default()
    }

    /// Drops what this stream says.
    pub fn new(stream: ChaCha8Rng) -> Self {
        Self { stream: Some(stream) }
    }

    /// Whether anything is ever dropped.
    pub fn active(&self) -> bool {
        self.stream.is_some()
    }

    /// Whether something of this probability (0 to 1, not included) happens; never without a stream.
    pub fn happens(&mut self, rate: f64) -> bool {
        self.stream.as_mut().is_some_and(|stream| stream.next_u32() < limit(rate))
    }

    /// Sets each value to 0 with this probability (0 to 1, not included) and scales the others, so that the mean stays.
    pub fn drop<const D: usize>(&mut self, values: Tensor<D>, rate: f64) -> Tensor<D> {
        let Some(stream) = self.stream.as_mut().filter(|_| rate > 0.0) else {
            return values;
        };
        let limit = limit(rate);
        let kept = (1.0 / (1.0 - rate)) as f32;
        let shape = values.dims();
        let mask: Vec<f32> = (0..shape.iter().product::<usize>())
            .map(|_| if stream.next_u32() < limit { 0.0 } else { kept })
            .collect();
        let mask = Tensor::from_data(TensorData::new(mask, shape), &values.device());
        values * mask
    }
}

/// What random numbers of 32 bits are below with this probability.
fn limit(rate: f64) -> u32 {
    (rate * f64::from(u32::MAX)) as u32
}
