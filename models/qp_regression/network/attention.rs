//! Attention of everything in a scene to everything in it, with what does not count closed.
//!
//! Scenes are small: one product with all pairs takes less time than gathering the sixteen neighbours of each token.

use burn::tensor::Tensor;
use burn::tensor::activation::softmax;

/// Added to the score of a closed pair: the exponential of what is left of it is exactly 0.
pub(crate) const CLOSED: f32 = -1e9;

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
    let taken = softmax(scores, 3).matmul(values);
    taken.swap_dims(1, 2).reshape([scenes * m, heads * v])
}
