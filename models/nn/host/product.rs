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
            let panel = if packed.is_empty() {
                Panel { numbers: &numbers[column..], stride: n, k, n }
            } else {
                Panel { numbers: &packed[column * k..][..PANEL * k], stride: PANEL, k, n }
            };
            for part in (0..PANEL).step_by(2 * lanes) {
                panel.starting_at(part).rows::<S, 2>(simd, x, &mut out[column + part..]);
            }
            column += PANEL;
        }
        while column + lanes <= n {
            let panel = Panel { numbers: &numbers[column..], stride: n, k, n };
            panel.rows::<S, 1>(simd, x, &mut out[column..]);
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

/// Some columns of the weights.
#[derive(Clone, Copy)]
struct Panel<'a> {
    numbers: &'a [f32],
    /// Distance from row to row.
    stride: usize,
    /// Number of rows.
    k: usize,
    /// Number of columns of the product.
    n: usize,
}

impl Panel<'_> {
    #[inline(always)]
    fn starting_at(self, column: usize) -> Self {
        Self { numbers: &self.numbers[column..], ..self }
    }

    /// Computes V registers of columns of all rows.
    #[inline(always)]
    fn rows<S: Simd, const V: usize>(self, simd: S, x: &[f32], out: &mut [f32]) {
        let count = x.len() / self.k;
        let mut row = 0;
        while row < count {
            let (x, out) = (&x[row * self.k..], &mut out[row * self.n..]);
            // As many sums as there are registers.
            row += match count - row {
                8.. if S::F32_LANES == 16 => self.tile::<S, V, 8>(simd, x, out),
                6.. => self.tile::<S, V, 6>(simd, x, out),
                4.. => self.tile::<S, V, 4>(simd, x, out),
                _ => self.tile::<S, V, 1>(simd, x, out),
            };
        }
    }

    /// Computes V registers of columns of R rows. Returns R.
    #[inline(always)]
    fn tile<S: Simd, const V: usize, const R: usize>(self, simd: S, x: &[f32], out: &mut [f32]) -> usize {
        let (k, lanes) = (self.k, S::F32_LANES);
        let mut rows = [x; R];
        for row in 0..R {
            rows[row] = &x[row * k..][..k];
        }
        let mut sums = [[simd.splat_f32s(0.0); V]; R];
        for i in 0..k {
            let (weights, _) = S::as_simd_f32s(&self.numbers[i * self.stride..][..V * lanes]);
            for row in 0..R {
                let factor = simd.splat_f32s(rows[row][i]);
                for v in 0..V {
                    sums[row][v] = simd.mul_add_e_f32s(factor, weights[v], sums[row][v]);
                }
            }
        }
        for row in 0..R {
            let (out, _) = S::as_mut_simd_f32s(&mut out[row * self.n..][..V * lanes]);
            for v in 0..V {
                out[v] = sums[row][v];
            }
        }
        R
    }
}
