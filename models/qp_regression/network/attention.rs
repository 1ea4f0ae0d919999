//! Attention of everything in a scene to everything in it, with what does not count closed.
//!
//! Scenes are small: one product with all pairs takes less time than gathering the sixteen neighbours of each token.

use burn::tensor::Tensor;
use burn::tensor::activation::softmax;

/// Added to the score of a closed pair.
pub(crate) const CLOSED: f32 = -1e9;
/// Scores are taken to be at least this. No open pair comes near it, and what a closed one takes is far below the last bit of any sum; the
/// exponential of -1e9 would be no number that processors are quick with.
const LEAST: f32 = -80.0;

/// `[scenes * n, heads * width]` to `[scenes, heads, n, width]`.
pub(crate) fn split(x: Tensor<2>, scenes: usize, heads: usize) -> Tensor<4> {
    let [rows, width] = x.dims();
    x.reshape([scenes, rows / scenes, heads, width / heads]).swap_dims(1, 2)
}

/// What queries take from values: queries `[scenes, heads, m, d]`, keys `[scenes, heads, n, d]`, values `[scenes, heads, n, v]`, and what
/// is added to scores, `[scenes, 1, m or 1, n]`. Returns `[scenes * m, heads * v]`.
pub(crate) fn attend(queries: Tensor<4>, keys: Tensor<4>, values: Tensor<4>, closed: Tensor<4>) -> Tensor<2> {
    let [scenes, heads, m, d] = queries.dims();
    let v = values.dims()[3];
    let scores = queries.matmul(keys.swap_dims(2, 3)) * (1.0 / (d as f32).sqrt()) + closed;
    let scores = scores.clamp_min(LEAST);
    let taken = softmax(scores, 3).matmul(values);
    taken.swap_dims(1, 2).reshape([scenes * m, heads * v])
}
