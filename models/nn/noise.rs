//! Dropout driven by a named random stream.

use burn::tensor::{Tensor, TensorData};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;

/// Source of dropout: none in inference, the caller's stream in training, so that a training step
/// can be repeated to the bit.
#[derive(Debug, Default)]
pub struct Noise {
    stream: Option<ChaCha8Rng>,
}

impl Noise {
    /// Returns a source that drops nothing.
    pub fn none() -> Self {
        Self::default()
    }

    /// Returns a source driven by this stream.
    pub fn new(stream: ChaCha8Rng) -> Self {
        Self { stream: Some(stream) }
    }

    /// Returns whether values are ever dropped.
    pub fn active(&self) -> bool {
        self.stream.is_some()
    }

    /// Draws an event of this probability (0 to 1, exclusive); always false without a stream.
    pub fn happens(&mut self, rate: f64) -> bool {
        self.stream.as_mut().is_some_and(|stream| stream.next_u32() < limit(rate))
    }

    /// Sets each value to 0 with this probability (0 to 1, exclusive) and scales the others so that
    /// the mean is unchanged.
    pub fn drop<const D: usize>(&mut self, values: Tensor<D>, rate: f64) -> Tensor<D> {
        let Some(stream) = self.stream.as_mut().filter(|_| rate > 0.0) else {
            return values;
        };
        let limit = limit(rate);
        let scale = (1.0 / (1.0 - rate)) as f32;
        let shape = values.dims();
        let mask: Vec<f32> = (0..shape.iter().product::<usize>())
            .map(|_| if stream.next_u32() < limit { 0.0 } else { scale })
            .collect();
        let mask = Tensor::from_data(TensorData::new(mask, shape), &values.device());
        values * mask
    }
}

/// Returns the bound that a random 32-bit number is below with this probability.
fn limit(rate: f64) -> u32 {
    (rate * f64::from(u32::MAX)) as u32
}
