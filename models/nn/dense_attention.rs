//! Dense attention over all tokens of a scene, with a mask for closed pairs.

use burn::tensor::Tensor;
use burn::tensor::activation::softmax;

use super::host::{self, Attention};

/// Added to the score of a closed pair.
pub const CLOSED: f32 = -1e9;
/// Lower bound of scores. No open pair comes near it, and the contribution of a closed pair at this
/// score is far below the last bit of any sum. Processors are slow at the exponential of -1e9.
const LEAST: f32 = -80.0;

/// Computes attention of m queries to n keys and values in each of `scenes` scenes. Scores are sums of the
/// products of queries `[scenes * m, heads * d]` and keys `[scenes * n, heads * d]`, scaled; `closed`,
/// `[scenes or 1, 1, m or 1, n or 1]`, is added to them. Values are `[scenes * n, heads * v]`. Returns
/// `[scenes * m, heads * v]`.
pub fn dense_attention(
    scenes: usize,
    heads: usize,
    products: Vec<(Tensor<2>, Tensor<2>)>,
    values: Tensor<2>,
    closed: Tensor<4>,
) -> Tensor<2> {
    let depth: usize = products.iter().map(|(queries, _)| queries.dims()[1] / heads).sum();
    let scale = 1.0 / (depth as f32).sqrt();
    if host::is_host(&values.device()) {
        return host::attend(Attention { scenes, heads, products, scale, closed, values });
    }
    let split = |x: Tensor<2>| {
        let [rows, width] = x.dims();
        x.reshape([scenes, rows / scenes, heads, width / heads]).swap_dims(1, 2)
    };
    let (queries, keys): (Vec<_>, Vec<_>) = products.into_iter().map(|(q, k)| (split(q), split(k))).unzip();
    let (queries, keys) = (Tensor::cat(queries, 3), Tensor::cat(keys, 3));
    let scores = queries.matmul(keys.swap_dims(2, 3)) * scale + closed;
    let taken = softmax(scores.clamp_min(LEAST), 3).matmul(split(values));
    let [_, _, m, v] = taken.dims();
    taken.swap_dims(1, 2).reshape([scenes * m, heads * v])
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};

    use super::*;
    use crate::device;

    fn made<const D: usize>(shape: [usize; D], seed: usize, device: &Device) -> Tensor<D> {
        let count = shape.iter().product::<usize>();
        let values: Vec<f32> = (0..count).map(|i| ((i * 7919 + seed) % 1009) as f32 / 250.0 - 2.0).collect();
        Tensor::from_data(TensorData::new(values, shape), device)
    }

    #[test]
    fn attention_on_the_host_equals_the_operations() {
        let (scenes, heads) = (3, 2);
        // Numbers of queries and keys, widths of the products and values, shape of the mask.
        for (m, n, [d, d2], v, mask) in [
            (9, 80, [16, 0], 16, [3, 1, 9, 80]),
            (8, 5, [6, 3], 21, [3, 1, 1, 5]),
            (1, 17, [33, 0], 3, [1, 1, 1, 1]),
            (20, 32, [4, 4], 32, [1, 1, 20, 32]),
        ] {
            let run = |device: &Device| {
                let pair = |d: usize, seed: usize| {
                    let queries = made([scenes * m, heads * d], seed, device);
                    (queries, made([scenes * n, heads * d], seed + 5, device))
                };
                let mut products = vec![pair(d, 1)];
                if d2 > 0 {
                    products.push(pair(d2, 2));
                }
                // The first query of a mask is closed for all keys.
                let columns = mask[3];
                let closed: Vec<f32> = (0..mask.iter().product::<usize>())
                    .map(|i| if columns > 1 && (i < columns || i % 3 == 0) { CLOSED } else { 0.0 })
                    .collect();
                let closed = Tensor::from_data(TensorData::new(closed, mask), device);
                let values = made([scenes * n, heads * v], 3, device);
                let out = dense_attention(scenes, heads, products, values, closed);
                out.into_data().iter::<f32>().collect::<Vec<_>>()
            };
            let (host, backend) = (run(&device()), run(&device().autodiff()));
            assert_eq!(host.len(), scenes * m * heads * v);
            for (a, b) in host.iter().zip(&backend) {
                assert!((a - b).abs() < 2e-5, "{m} {n}: {a} {b}");
            }
        }
    }
}
