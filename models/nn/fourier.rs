//! Embedding of scalars: learned frequencies and one perceptron per scalar.

use std::f32::consts::TAU;

use burn::module::{Module, Param};
use burn::nn::{LayerNorm, Linear};
use burn::tensor::{Device, Tensor, TensorData};

use super::fused;
use super::host::is_host;
use super::turns::cos_sin_rows;
use super::{Activation, Initializer, Perceptron, PerceptronKind, Rows, linear};

/// Rows per pass through the layers, so that intermediate results stay in the processor's caches.
const CHUNK_ROWS: usize = 1024;

/// The perceptron of a scalar.
const SCALAR: PerceptronKind =
    PerceptronKind { activation: Activation::Relu, linears: &["0", "3"], norms: &["1"] };

/// Fourier embedding of the SMART family. Every scalar u is expanded to cos(2πfu) and sin(2πfu) for
/// its own learned frequencies f, and u itself, and passes its own perceptron. The sum of the
/// results and of categorical vectors passes a norm, ReLU and a last linear layer.
#[derive(Module, Debug)]
pub struct FourierEmbedding {
    /// Shape [scalars, frequencies].
    freqs: Param<Tensor<2>>,
    mlps: Vec<Perceptron>,
    merge_norm: LayerNorm,
    merge: Linear,
}

impl FourierEmbedding {
    /// Builds an embedding of `scalars` scalars with `frequencies` frequencies each into vectors of
    /// width `width`.
    pub fn init(scalars: usize, frequencies: usize, width: usize, init: &mut Initializer) -> Self {
        Self {
            freqs: init.normal([scalars, frequencies], 0.02),
            mlps: (0..scalars).map(|_| SCALAR.init(&[2 * frequencies + 1, width, width], init)).collect(),
            merge_norm: init.norm(width),
            merge: init.linear(width, width, true),
        }
    }

    /// Embeds scalars [E, D], and the sum [E, width] of categorical vectors if there are any, into
    /// [E, width].
    ///
    /// # Panics
    /// If the number of scalars differs from that of the embedding.
    pub fn forward(&self, scalars: Tensor<2>, categorical: Option<Tensor<2>>) -> Tensor<2> {
        let [rows, count] = scalars.dims();
        let [own, frequencies] = self.freqs.dims();
        assert_eq!(count, own, "scalars of a Fourier embedding");
        let features = |d| {
            let u = scalars.clone().narrow(1, d, 1);
            let f = self.freqs.val().narrow(0, d, 1);
            if let Some(features) = fused::cos_sin(&u, &f) {
                return features;
            }
            let angle = (u.clone().expand([rows, frequencies]) * f) * TAU;
            Tensor::cat(vec![angle.clone().cos(), angle.sin(), u], 1)
        };
        self.embed_features(rows, features, categorical, &scalars.device())
    }

    /// Like [`FourierEmbedding::forward`], for scalars on the host, row by row. Cosines and sines
    /// are computed on the host, many at a time, unless gradients are needed or the device is a
    /// GPU: the CPU backends call the system's math library once per value, which takes longer than
    /// all products of the embedding.
    ///
    /// # Panics
    /// If the scalars are not whole rows of the embedding's number of scalars.
    pub fn forward_host(
        &self,
        scalars: &[f32],
        categorical: Option<Tensor<2>>,
        device: &Device,
    ) -> Tensor<2> {
        let [count, frequencies] = self.freqs.dims();
        assert_eq!(scalars.len() % count, 0, "scalars of a Fourier embedding");
        let rows = scalars.len() / count;
        if !is_host(device) {
            let scalars = TensorData::new(scalars.to_vec(), [rows, count]);
            return self.forward(Tensor::from_data(scalars, device), categorical);
        }
        let frequency: Vec<f32> = self.freqs.val().into_data().iter::<f32>().collect();
        let mut parts = Vec::new();
        for (i, scalars) in scalars.chunks(CHUNK_ROWS * count).enumerate() {
            let rows = scalars.len() / count;
            let features = |d: usize| {
                let own = scalars.iter().skip(d).step_by(count).copied();
                let values = cos_sin_rows(own, &frequency[d * frequencies..][..frequencies]);
                Tensor::from_data(TensorData::new(values, [rows, 2 * frequencies + 1]), device)
            };
            let categorical = categorical.clone().map(|c| c.narrow(0, i * CHUNK_ROWS, rows));
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
        for (d, mlp) in self.mlps.iter().enumerate() {
            let x = mlp.forward(features(d));
            sum = Some(match sum {
                Some(sum) => sum + x,
                None => x,
            });
        }
        let sum = sum.unwrap_or_else(|| Tensor::zeros([rows, self.width()], device));
        linear(&self.merge, Rows::of(sum).norm(&self.merge_norm).relu().done())
    }

    /// Returns the width of the embedded vectors.
    pub fn width(&self) -> usize {
        self.merge.weight.dims()[1]
    }
}
