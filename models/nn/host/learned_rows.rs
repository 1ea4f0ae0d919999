//! Products with bias, norm and activation, and their gradients.

use pulp::{Arch, Simd, WithSimd};

use super::LANES;
use super::product::{BLOCK_ROWS, Product, Weights};
use super::rows::{Finish, sum};

/// Rows after [`learned_rows`].
pub(crate) struct LearnedRows {
    /// The result, row by row.
    pub rows: Vec<f32>,
    /// The products, before bias, norm and activation; empty if gradients do not need them.
    pub products: Vec<f32>,
}

/// Gradients with respect to what [`Finish`] is given.
pub(crate) struct RowGradients {
    /// With respect to the rows.
    pub rows: Vec<f32>,
    /// With respect to the bias, `[width]`.
    pub bias: Vec<f32>,
    /// With respect to the gain of the norm, `[width]`.
    pub gain: Vec<f32>,
    /// With respect to the shift of the norm, `[width]`.
    pub shift: Vec<f32>,
}

/// Number of rows whose gradients are added up before they are added to the others, which keeps sums exact.
const SUMMED_ROWS: usize = 64;

/// Multiplies rows of the matrix `x` with weights `[k, width]`, if there are any, and finishes them.
///
/// # Panics
/// If the lengths do not fit together.
pub(crate) fn learned_rows(x: &[f32], weights: Option<&[f32]>, finish: &Finish<'_>) -> LearnedRows {
    let width = finish.width;
    let k = weights.map_or(width, |weights| weights.len() / width);
    let count = x.len() / k;
    assert_eq!(x.len(), count * k, "whole rows");
    let mut out = LearnedRows { rows: vec![0.0; count * width], products: Vec::new() };
    let arch = Arch::new();
    let packed = weights.map(|weights| Weights::new(weights, width, count));
    if packed.is_some() && (finish.norm.is_some() || finish.relu) {
        out.products = vec![0.0; count * width];
    }
    for (block, rows) in out.rows.chunks_mut(BLOCK_ROWS * width).enumerate() {
        let first = block * BLOCK_ROWS;
        let x = &x[first * k..][..rows.len() / width * k];
        match &packed {
            None => rows.copy_from_slice(x),
            Some(weights) if out.products.is_empty() => arch.dispatch(Product { weights, x, out: rows }),
            Some(weights) => {
                let products = &mut out.products[first * width..][..rows.len()];
                arch.dispatch(Product { weights, x, out: products });
                rows.copy_from_slice(products);
            }
        }
        finish.apply_all(rows);
    }
    out
}

/// Returns the gradients with respect to the matrix that is multiplied with weights `[k, width]`, for the
/// gradients with respect to the products.
pub(crate) fn matrix_gradients(of_products: &[f32], weights: &[f32], width: usize) -> Vec<f32> {
    let (k, count) = (weights.len() / width, of_products.len() / width);
    let mut transposed = vec![0.0; weights.len()];
    for (row, numbers) in weights.chunks_exact(width).enumerate() {
        for (column, number) in numbers.iter().enumerate() {
            transposed[column * k + row] = *number;
        }
    }
    let mut out = vec![0.0; count * k];
    let (arch, weights) = (Arch::new(), Weights::new(&transposed, k, count));
    let blocks = of_products.chunks(BLOCK_ROWS * width).zip(out.chunks_mut(BLOCK_ROWS * k));
    blocks.for_each(|(x, out)| arch.dispatch(Product { weights: &weights, x, out }));
    out
}

/// Returns the gradients of [`Finish`] for its input rows and the gradients with respect to its output rows.
///
/// # Panics
/// If the lengths do not fit together.
pub(crate) fn row_gradients(finish: &Finish<'_>, rows: &[f32], of_output: &[f32]) -> RowGradients {
    let width = finish.width;
    assert_eq!(rows.len(), of_output.len(), "a gradient for every number");
    let zeros = || vec![0.0; width];
    let mut all = RowGradients { rows: vec![0.0; rows.len()], bias: zeros(), gain: zeros(), shift: zeros() };
    let block = SUMMED_ROWS * width;
    let RowGradients { rows: of_rows, bias, gain, shift } = &mut all;
    let blocks = rows.chunks(block).zip(of_output.chunks(block)).zip(of_rows.chunks_mut(block));
    let (arch, no_shift) = (Arch::new(), zeros());
    let (mut input, mut sums) = (zeros(), [zeros(), zeros(), zeros()]);
    for ((rows, of_output), of_rows) in blocks {
        sums.iter_mut().for_each(|sum| sum.fill(0.0));
        let (input, sums) = (&mut input, &mut sums);
        arch.dispatch(Backward { finish, rows, of_output, of_rows, input, zeros: &no_shift, sums });
        for (all, sum) in [&mut *bias, gain, shift].into_iter().zip(&*sums) {
            all.iter_mut().zip(sum).for_each(|(all, sum)| *all += sum);
        }
    }
    all
}

/// A block of rows, space for one, a row of zeros, and the sums over the block: gradients of bias, gain and
/// shift.
struct Backward<'a, 'b> {
    finish: &'a Finish<'a>,
    rows: &'a [f32],
    of_output: &'a [f32],
    of_rows: &'b mut [f32],
    input: &'b mut [f32],
    zeros: &'a [f32],
    sums: &'b mut [Vec<f32>; 3],
}

impl WithSimd for Backward<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { finish, rows, of_output, of_rows, input, zeros, sums: [bias, gain, shift] } = self;
        let width = finish.width;
        let (input, of_bias) = (&mut input[..width], &mut bias[..width]);
        // Numbers up to this one pass no gradient; NaN does.
        let floor = if finish.relu { 0.0 } else { f32::NEG_INFINITY };
        let each = rows.chunks_exact(width).zip(of_output.chunks_exact(width));
        for ((row, of_output), own) in each.zip(of_rows.chunks_exact_mut(width)) {
            // Of known length, so that loops over columns need no checks and become vector instructions.
            let (of_output, own) = (&of_output[..width], &mut own[..width]);
            match finish.bias {
                Some(bias) => add(input, row, bias),
                None => input.copy_from_slice(row),
            }
            match &finish.norm {
                Some(norm) => {
                    let factor = standardize(input, norm.epsilon);
                    let of_norm = NormSums { gain, shift };
                    of_norm.add(input, of_output, own, (norm.gain, norm.shift.unwrap_or(zeros)), floor);
                    through_norm(own, input, factor);
                }
                None => {
                    for i in 0..width {
                        own[i] = if input[i] <= floor { 0.0 } else { of_output[i] };
                    }
                }
            }
            for i in 0..width {
                of_bias[i] += own[i];
            }
        }
    }
}

/// Sums of the gradients of gain and shift.
struct NormSums<'a> {
    gain: &'a mut [f32],
    shift: &'a mut [f32],
}

impl NormSums<'_> {
    /// Adds the gradients of a row, and writes those with respect to the normalised row.
    #[inline(always)]
    fn add(
        self,
        normalized: &[f32],
        of_output: &[f32],
        of_normalized: &mut [f32],
        (gain, shift): (&[f32], &[f32]),
        floor: f32,
    ) {
        let (blocks, first) = (normalized.len() / LANES, normalized.len() / LANES * LANES);
        // Copies of a register's length: a loop over slices, of which some are written, would not become
        // vector instructions.
        let at = |numbers: &[f32], block: usize| numbers.as_chunks::<LANES>().0[block];
        for block in 0..blocks {
            let (x, gain, shift, given) =
                (at(normalized, block), at(gain, block), at(shift, block), at(of_output, block));
            let mut passed = [0.0; LANES];
            for i in 0..LANES {
                passed[i] = if x[i] * gain[i] + shift[i] <= floor { 0.0 } else { given[i] };
            }
            let of_gain = &mut self.gain.as_chunks_mut::<LANES>().0[block];
            for i in 0..LANES {
                of_gain[i] += passed[i] * x[i];
            }
            let of_shift = &mut self.shift.as_chunks_mut::<LANES>().0[block];
            for i in 0..LANES {
                of_shift[i] += passed[i];
            }
            let of_normalized = &mut of_normalized.as_chunks_mut::<LANES>().0[block];
            for i in 0..LANES {
                of_normalized[i] = passed[i] * gain[i];
            }
        }
        for i in first..normalized.len() {
            let output = normalized[i] * gain[i] + shift[i];
            let passed = if output <= floor { 0.0 } else { of_output[i] };
            self.gain[i] += passed * normalized[i];
            self.shift[i] += passed;
            of_normalized[i] = passed * gain[i];
        }
    }
}

#[inline(always)]
fn add(out: &mut [f32], row: &[f32], bias: &[f32]) {
    let (row, bias) = (&row[..out.len()], &bias[..out.len()]);
    for i in 0..out.len() {
        out[i] = row[i] + bias[i];
    }
}

/// Normalises a row to zero mean and unit variance. Returns the factor that it was multiplied with.
#[inline(always)]
fn standardize(row: &mut [f32], epsilon: f32) -> f32 {
    let share = 1.0 / row.len() as f32;
    let mean = sum(row, |x| x) * share;
    let variance = sum(row, |x| (x - mean) * (x - mean)) * share;
    let factor = 1.0 / (variance + epsilon).sqrt();
    for x in row {
        *x = (*x - mean) * factor;
    }
    factor
}

/// Turns the gradient with respect to a normalised row into that with respect to the row itself.
#[inline(always)]
fn through_norm(gradient: &mut [f32], normalized: &[f32], factor: f32) {
    let normalized = &normalized[..gradient.len()];
    let share = 1.0 / gradient.len() as f32;
    let mean = sum(gradient, |g| g) * share;
    let along = dot(gradient, normalized) * share;
    for i in 0..gradient.len() {
        gradient[i] = factor * (gradient[i] - mean - normalized[i] * along);
    }
}

/// Adds up products, each [`LANES`]-th in a sum of its own.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; LANES];
    let ((blocks, rest), (others, other_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (block, other) in blocks.iter().zip(others) {
        for i in 0..LANES {
            sums[i] += block[i] * other[i];
        }
    }
    for i in 0..rest.len() {
        sums[i] += rest[i] * other_rest[i];
    }
    sums.into_iter().sum()
}
