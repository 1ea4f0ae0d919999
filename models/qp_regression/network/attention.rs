//! Dense attention over all tokens of a scene, with a mask for closed pairs.
//!
//! Scenes are small: one product over all pairs takes less time than gathering the sixteen neighbours
//! of each token.

use burn::tensor::Tensor;
use burn::tensor::activation::softmax;

/// Added to the score of a closed pair.
pub(crate) const CLOSED: f32 = -1e9;
/// Lower bound of scores. No open pair comes near it, and the contribution of a closed pair at this
/// score is far below the last bit of any sum. Processors are slow at the exponential of -1e9.
const LEAST: f32 = -80.0;

/// Reshapes `[scenes * n, heads * width]` to `[scenes, heads, n, width]`.
pub(crate) fn split(x: Tensor<2>, scenes: usize, heads: usize) -> Tensor<4> {
    let [rows, width] = x.dims();
    x.reshape([scenes, rows / scenes, heads, width / heads]).swap_dims(1, 2)
}

/// Computes attention of queries `[scenes, heads, m, d]` to keys `[scenes, heads, n, d]` and values
/// `[scenes, heads, n, v]`; `closed`, `[scenes, 1, m or 1, n]`, is added to the scores. Returns
/// `[scenes * m, heads * v]`.
pub(crate) fn attend(queries: Tensor<4>, keys: Tensor<4>, values: Tensor<4>, closed: Tensor<4>) -> Tensor<2> {
    let [scenes, heads, m, d] = queries.dims();
    let v = values.dims()[3];
    let scores = queries.matmul(keys.swap_dims(2, 3)) * (1.0 / (d as f32).sqrt()) + closed;
    let scores = scores.clamp_min(LEAST);
    let taken = softmax(scores, 3).matmul(values);
    taken.swap_dims(1, 2).reshape([scenes * m, heads * v])
}
