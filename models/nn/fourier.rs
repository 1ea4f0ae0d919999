//! Numbers as vectors: learned frequencies, one perceptron per number.

use std::f32::consts::TAU;

use burn::module::{Module, Param};
use burn::nn::{LayerNorm, Linear};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};

use super::Initializer;
use super::turns::cos_sin_rows;

/// How many rows go through the layers at a time, so that what is between them stays in the processor's caches.
const CHUNK: usize = 1024;

/// The Fourier embedding of the SMART family: every scalar u gives cos(2πfu) and sin(2πfu) for its own learned frequencies f, and u
/// itself; a perceptron per scalar; the sum, with categorical vectors added, through norm, ReLU and a last linear layer.
#[derive(Module, Debug)]
pub struct FourierEmbedding {
    /// [scalars, frequencies]
    freqs: Param<Tensor<2>>,
    mlps: Vec<ScalarLayers>,
    merge_norm: LayerNorm,
    merge: Linear,
}

/// What one scalar goes through: linear, layer norm, ReLU, linear.
#[derive(Module, Debug)]
pub struct ScalarLayers {
    lift: Linear,
    lift_norm: LayerNorm,
    mix: Linear,
}

impl FourierEmbedding {
    /// For this many scalars, with this many frequencies each, into vectors of this width.
    pub fn init(scalars: usize, frequencies: usize, width: usize, init: &mut Initializer) -> Self {
        let layers = |init: &mut Initializer| ScalarLayers {
            lift: init.linear(2 * frequencies + 1, width, true),
            lift_norm: init.norm(width),
            mix: init.linear(width, width, true),
        };
        Self {
            freqs: init.normal([scalars, frequencies], 0.02),
            mlps: (0..scalars).map(|_| layers(init)).collect(),
            merge_norm: init.norm(width),
            merge: init.linear(width, width, true),
        }
    }

    /// Scalars [E, D] and, if there are any, the sum of the categorical vectors [E, width] to [E, width].
    ///
    /// # Panics
    /// If the scalars are not as many as the embedding was made for.
    pub fn forward(&self, scalars: Tensor<2>, categorical: Option<Tensor<2>>) -> Tensor<2> {
        let [rows, count] = scalars.dims();
        let [own, frequencies] = self.freqs.dims();
        assert_eq!(count, own, "scalars of a Fourier embedding");
        let features = |d| {
            let u = scalars.clone().narrow(1, d, 1);
            let f = self.freqs.val().narrow(0, d, 1);
            let angle = (u.clone().expand([rows, frequencies]) * f) * TAU;
            Tensor::cat(vec![angle.clone().cos(), angle.sin(), u], 1)
        };
        self.embed_features(rows, features, categorical, &scalars.device())
    }

    /// As [`FourierEmbedding::forward`], of scalars that are still on the host, row by row. Cosines and sines are worked out there, many
    /// at a time, unless gradients are wanted or the device is another machine: the backends for processors ask the system's library for
    /// one after the other, which takes longer than all products of the embedding.
    ///
    /// # Panics
    /// If the scalars are no whole rows of as many as the embedding was made for.
    pub fn forward_host(
        &self,
        scalars: &[f32],
        categorical: Option<Tensor<2>>,
        device: &Device,
    ) -> Tensor<2> {
        let [count, frequencies] = self.freqs.dims();
        assert_eq!(scalars.len() % count, 0, "scalars of a Fourier embedding");
        let rows = scalars.len() / count;
        if device.is_autodiff() || cfg!(any(feature = "cuda", feature = "wgpu")) {
            let scalars = TensorData::new(scalars.to_vec(), [rows, count]);
            return self.forward(Tensor::from_data(scalars, device), categorical);
        }
        let frequency: Vec<f32> = self.freqs.val().into_data().iter::<f32>().collect();
        let mut parts = Vec::new();
        for (i, scalars) in scalars.chunks(CHUNK * count).enumerate() {
            let rows = scalars.len() / count;
            let features = |d: usize| {
                let own = scalars.iter().skip(d).step_by(count).copied();
                let values = cos_sin_rows(own, &frequency[d * frequencies..][..frequencies]);
                Tensor::from_data(TensorData::new(values, [rows, 2 * frequencies + 1]), device)
            };
            let categorical = categorical.clone().map(|c| c.narrow(0, i * CHUNK, rows));
            parts.push(self.embed_features(rows, features, categorical, device));
        }
        match parts.len() {
            0 => Tensor::zeros([0, self.width()], device),
            1 => parts.remove(0),
            _ => Tensor::cat(parts, 0),
        }
    }

    fn embed_features(
        &self,
        rows: usize,
        features: impl Fn(usize) -> Tensor<2>,
        categorical: Option<Tensor<2>>,
        device: &Device,
    ) -> Tensor<2> {
        let mut sum = categorical;
        for (d, layers) in self.mlps.iter().enumerate() {
            let x = layers.mix.forward(relu(layers.lift_norm.forward(layers.lift.forward(features(d)))));
            sum = Some(match sum {
                Some(sum) => sum + x,
                None => x,
            });
        }
        let sum = sum.unwrap_or_else(|| Tensor::zeros([rows, self.width()], device));
        self.merge.forward(relu(self.merge_norm.forward(sum)))
    }

    /// The width of its vectors.
    pub fn width(&self) -> usize {
        self.merge.weight.dims()[1]
    }
}
