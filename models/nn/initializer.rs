//! Initial weights that are a function of a seed.

use burn::module::Param;
use burn::nn::{Embedding, EmbeddingConfig, LayerNorm, LayerNormConfig, Linear};
use burn::tensor::{Device, Tensor, TensorData};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use reactsim::geometry::math;

/// Draws initial weights, one layer after the other, from one stream. burn's own initialisation is not used: its seed belongs to the
/// whole process.
#[derive(Debug)]
pub struct Initializer {
    stream: ChaCha8Rng,
    device: Device,
}

impl Initializer {
    /// The stream of this seed; weights are made on this device. The same seed gives the same weights on every machine.
    pub fn new(seed: u64, device: &Device) -> Self {
        let mut name = Vec::from(b"reactsim weights");
        name.extend_from_slice(&seed.to_le_bytes());
        Self { stream: ChaCha8Rng::from_seed(*blake3::hash(&name).as_bytes()), device: device.clone() }
    }

    /// Where the weights are.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Between 0 (not included) and 1.
    fn unit(&mut self) -> f64 {
        // 53 bits, moved by half a step so that 0, whose logarithm is not finite, cannot come.
        ((self.stream.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    /// Uniform between `-bound` and `bound`, in this shape.
    pub fn uniform<const D: usize>(&mut self, shape: [usize; D], bound: f64) -> Param<Tensor<D>> {
        let values =
            (0..shape.iter().product()).map(|_| ((2.0 * self.unit() - 1.0) * bound) as f32).collect();
        self.param(values, shape)
    }

    /// Normal with mean 0 and this deviation, in this shape.
    pub fn normal<const D: usize>(&mut self, shape: [usize; D], deviation: f64) -> Param<Tensor<D>> {
        let draw = |_| {
            let radius = (-2.0 * math::ln(self.unit())).sqrt();
            (radius * math::cos(std::f64::consts::TAU * self.unit()) * deviation) as f32
        };
        let values = (0..shape.iter().product()).map(draw).collect();
        self.param(values, shape)
    }

    /// A linear layer: weights uniform after Glorot (bound √(6 / (in + out))), bias 0.
    pub fn linear(&mut self, inputs: usize, outputs: usize, bias: bool) -> Linear {
        let bound = (6.0 / (inputs + outputs) as f64).sqrt();
        let weight = self.uniform([inputs, outputs], bound);
        let bias = bias.then(|| self.param(vec![0.0; outputs], [outputs]));
        Linear { weight, bias }
    }

    /// A table of `rows` learned vectors, normal with deviation 0.02.
    pub fn embedding(&mut self, rows: usize, width: usize) -> Embedding {
        let mut table = EmbeddingConfig::new(rows, width).init(&self.device);
        table.weight = self.normal([rows, width], 0.02);
        table
    }

    /// A layer norm with gains 1 and biases 0, epsilon 1e-5.
    pub fn norm(&self, width: usize) -> LayerNorm {
        LayerNormConfig::new(width).init(&self.device)
    }

    fn param<const D: usize>(&self, values: Vec<f32>, shape: [usize; D]) -> Param<Tensor<D>> {
        Param::from_data(TensorData::new(values, shape), &self.device)
    }
}
