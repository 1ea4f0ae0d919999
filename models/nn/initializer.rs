//! Initial weights as a function of a seed.

use burn::module::{Param, ParamId};
use burn::nn::{Embedding, EmbeddingConfig, LayerNorm, LayerNormConfig, Linear};
use burn::tensor::{Device, Tensor, TensorData};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use reactsim_geometry::math;

/// Draws initial weights from one stream, layer by layer. burn's own initialization is not used
/// because its seed is global to the process.
#[derive(Debug)]
pub struct Initializer {
    /// `None` if the weights have no values yet.
    stream: Option<ChaCha8Rng>,
    device: Device,
}

impl Initializer {
    /// Starts the stream of this seed for weights on this device. The same seed gives the same
    /// weights on every machine.
    pub fn new(seed: u64, device: &Device) -> Self {
        let mut name = Vec::from(b"reactsim weights");
        name.extend_from_slice(&seed.to_le_bytes());
        let stream = ChaCha8Rng::from_seed(*blake3::hash(&name).as_bytes());
        Self { stream: Some(stream), device: device.clone() }
    }

    /// Starts a network whose weights are only shapes, to be replaced by those of a file
    /// ([`Tensors::load`](super::Tensors::load)). It takes no memory, whatever sizes a file claims to have.
    pub fn blank(device: &Device) -> Self {
        Self { stream: None, device: device.clone() }
    }

    /// Returns the device of the weights.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Draws a tensor of this shape uniformly between `-bound` and `bound`.
    pub fn uniform<const D: usize>(&mut self, shape: [usize; D], bound: f64) -> Param<Tensor<D>> {
        self.draw(shape, |stream| (2.0 * unit(stream) - 1.0) * bound)
    }

    /// Draws a tensor of this shape from a normal distribution with mean 0 and this standard
    /// deviation.
    pub fn normal<const D: usize>(&mut self, shape: [usize; D], deviation: f64) -> Param<Tensor<D>> {
        self.draw(shape, |stream| math::standard_normal(unit(stream), unit(stream)) * deviation)
    }

    /// Builds a linear layer with uniform Glorot weights (bound √(6 / (in + out))) and bias 0.
    pub fn linear(&mut self, inputs: usize, outputs: usize, bias: bool) -> Linear {
        let bound = (6.0 / (inputs + outputs) as f64).sqrt();
        let weight = self.uniform([inputs, outputs], bound);
        let bias = bias.then(|| self.draw([outputs], |_| 0.0));
        Linear { weight, bias }
    }

    /// Builds a table of `rows` learned vectors, normally distributed with standard deviation 0.02.
    pub fn embedding(&mut self, rows: usize, width: usize) -> Embedding {
        let mut table = EmbeddingConfig::new(rows, width).init(&self.device);
        table.weight = self.normal([rows, width], 0.02);
        table
    }

    /// Builds a layer norm with gain 1, bias 0 and epsilon 1e-5.
    pub fn norm(&self, width: usize) -> LayerNorm {
        LayerNormConfig::new(width).init(&self.device)
    }

    /// Builds a tensor of this shape from values that are drawn row by row.
    fn draw<const D: usize>(
        &mut self,
        shape: [usize; D],
        value: impl Fn(&mut ChaCha8Rng) -> f64,
    ) -> Param<Tensor<D>> {
        let Some(stream) = &mut self.stream else { return blank(shape, &self.device) };
        let values: Vec<f32> = (0..shape.iter().product()).map(|_| value(stream) as f32).collect();
        Param::from_data(TensorData::new(values, shape), &self.device)
    }
}

/// Returns a parameter of this shape that has no values before they are needed.
fn blank<const D: usize>(shape: [usize; D], device: &Device) -> Param<Tensor<D>> {
    let zeros = move |device: &Device, learns: bool| {
        let tensor = Tensor::zeros(shape, device);
        if learns { tensor.require_grad() } else { tensor }
    };
    Param::uninitialized(ParamId::new(), zeros, device.clone(), true, shape.into())
}

/// Draws a number between 0 (exclusive) and 1.
fn unit(stream: &mut ChaCha8Rng) -> f64 {
    // 53 bits, shifted by half a step so that 0, whose logarithm is not finite, cannot occur.
    ((stream.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
}
