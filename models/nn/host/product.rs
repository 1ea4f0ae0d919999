//! Products of a tall matrix and a matrix of weights.

use pulp::Simd;

/// Vector registers of columns that are computed together.
const VECTORS: usize = 2;
/// Rows that go through all weights before the next, so that they stay in the caches.
pub(super) const BLOCK_ROWS: usize = 48;
/// Rows from which on it pays to copy the weights, so that a panel is contiguous.
const MIN_ROWS_TO_PACK: usize = 32;

/// Weights `[k, n]`, row by row.
pub(super) struct Weights<'a> {
    numbers: &'a [f32],
    k: usize,
    n: usize,
    /// Panels of [`VECTORS`] registers of columns, one after the other, each with all k rows; empty if they
    /// are read where they are.
    packed: Vec<f32>,
}

impl<'a> Weights<'a> {
    /// Prepares weights for the product with a matrix of this many rows.
    #[inline(always)]
    pub(super) fn new<S: Simd>(_: S, numbers: &'a [f32], n: usize, rows: usize) -> Self {
        let (k, width) = (numbers.len() / n.max(1), VECTORS * S::F32_LANES);
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

    /// Writes the product of `x`, `[rows, k]`, with the weights, `[rows, n]`. A row depends on that row of `x`
    /// alone, to the last bit.
    #[inline(always)]
    pub(super) fn multiply<S: Simd>(&self, simd: S, x: &[f32], out: &mut [f32]) {
        let Self { k, n, .. } = *self;
        let lanes = S::F32_LANES;
        let width = VECTORS * lanes;
        let mut column = 0;
        while column + width <= n {
            let (panel, stride) = if self.packed.is_empty() {
                (&self.numbers[column..], n)
            } else {
                (&self.packed[column * k..][..width * k], width)
            };
            rows::<S, VECTORS>(simd, x, k, panel, stride, &mut out[column..], n);
            column += width;
        }
        while column + lanes <= n {
            rows::<S, 1>(simd, x, k, &self.numbers[column..], n, &mut out[column..], n);
            column += lanes;
        }
        for (x, out) in x.chunks_exact(k).zip(out.chunks_exact_mut(n)) {
            for j in column..n {
                let mut sum = 0.0;
                for i in 0..k {
                    sum += x[i] * self.numbers[i * n + j];
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
