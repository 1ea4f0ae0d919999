//! Products of a tall matrix and a matrix of weights.

use pulp::{Simd, WithSimd};

use super::LANES;

/// Columns that are computed together: two of the largest registers.
const PANEL: usize = 2 * LANES;
/// Rows that go through all weights before the next, so that they stay in the caches.
pub(super) const BLOCK_ROWS: usize = 48;
/// Rows from which on it pays to copy the weights, so that a panel is contiguous.
const MIN_ROWS_TO_PACK: usize = 32;

/// Weights `[k, n]`, row by row.
pub(super) struct Weights<'a> {
    numbers: &'a [f32],
    k: usize,
    n: usize,
    /// Panels of [`PANEL`] columns, one after the other, each with all k rows; empty if they are read where
    /// they are.
    packed: Vec<f32>,
}

impl<'a> Weights<'a> {
    /// Prepares weights for the product with a matrix of this many rows.
    pub(super) fn new(numbers: &'a [f32], n: usize, rows: usize) -> Self {
        let (k, width) = (numbers.len() / n, PANEL);
        let mut packed = Vec::new();
        if rows >= MIN_ROWS_TO_PACK && n >= width {
            packed.reserve_exact(n / width * width * k);
            for panel in 0..n / width {
                for row in 0..k {
                    packed.extend_from_slice(&numbers[row * n + panel * width..][..width]);
                }
            }
        }
        Self { numbers, k, n, packed }
    }
}

/// Product of a matrix `[rows, k]` with weights, `[rows, n]`. A row of the product depends on that row of the
/// matrix alone, to the last bit.
pub(super) struct Product<'a> {
    /// Weights.
    pub weights: &'a Weights<'a>,
    /// The matrix.
    pub x: &'a [f32],
    /// The product.
    pub out: &'a mut [f32],
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { weights: Weights { numbers, k, n, packed }, x, out } = self;
        let (k, n, lanes) = (*k, *n, S::F32_LANES);
        let mut column = 0;
        while column + PANEL <= n {
            let (panel, stride) = if packed.is_empty() {
                (&numbers[column..], n)
            } else {
                (&packed[column * k..][..PANEL * k], PANEL)
            };
            for part in (0..PANEL).step_by(2 * lanes) {
                rows::<S, 2>(simd, x, k, &panel[part..], stride, &mut out[column + part..], n);
            }
            column += PANEL;
        }
        while column + lanes <= n {
            rows::<S, 1>(simd, x, k, &numbers[column..], n, &mut out[column..], n);
            column += lanes;
        }
        for (x, out) in x.chunks_exact(k).zip(out.chunks_exact_mut(n)) {
            for j in column..n {
                let mut sum = 0.0;
                for i in 0..k {
                    sum += x[i] * numbers[i * n + j];
                }
                out[j] = sum;
            }
        }
    }
}

/// Computes V registers of columns of all rows.
#[inline(always)]
fn rows<S: Simd, const V: usize>(
    simd: S,
    x: &[f32],
    k: usize,
    panel: &[f32],
    stride: usize,
    out: &mut [f32],
    n: usize,
) {
    let count = x.len() / k;
    let mut row = 0;
    while row < count {
        let (x, out) = (&x[row * k..], &mut out[row * n..]);
        // As many sums as there are registers.
        row += match count - row {
            8.. if S::F32_LANES == 16 => tile::<S, V, 8>(simd, x, k, panel, stride, out, n),
            6.. => tile::<S, V, 6>(simd, x, k, panel, stride, out, n),
            4.. => tile::<S, V, 4>(simd, x, k, panel, stride, out, n),
            _ => tile::<S, V, 1>(simd, x, k, panel, stride, out, n),
        };
    }
}

/// Computes V registers of columns of R rows. Returns R.
#[inline(always)]
fn tile<S: Simd, const V: usize, const R: usize>(
    simd: S,
    x: &[f32],
    k: usize,
    panel: &[f32],
    stride: usize,
    out: &mut [f32],
    n: usize,
) -> usize {
    let lanes = S::F32_LANES;
    let mut rows = [x; R];
    for row in 0..R {
        rows[row] = &x[row * k..][..k];
    }
    let mut sums = [[simd.splat_f32s(0.0); V]; R];
    for i in 0..k {
        let (weights, _) = S::as_simd_f32s(&panel[i * stride..][..V * lanes]);
        for row in 0..R {
            let factor = simd.splat_f32s(rows[row][i]);
            for v in 0..V {
                sums[row][v] = simd.mul_add_e_f32s(factor, weights[v], sums[row][v]);
            }
        }
    }
    for row in 0..R {
        let (out, _) = S::as_mut_simd_f32s(&mut out[row * n..][..V * lanes]);
        for v in 0..V {
            out[v] = sums[row][v];
        }
    }
    R
}
