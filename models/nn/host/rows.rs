//! Matrix products, norms and activations in one pass.

use burn::tensor::{Tensor, TensorData};
use pulp::{Arch, Simd, WithSimd};

use super::product::{BLOCK_ROWS, Product, Weights};
use super::{LANES, Numbers};

/// Rows that are normalised together, so that the processor adds up several at once.
const TOGETHER: usize = 4;

/// Operations on each row of a matrix, in this order.
#[derive(Default)]
pub(crate) struct RowPass {
    /// Weights `[k, width]` that rows of width k are multiplied with; otherwise they have this width.
    pub weights: Option<Tensor<2>>,
    /// Matrices `[m, width]` that are added: their row r to the rows r, r + m, r + 2m and so on.
    pub added: Vec<Tensor<2>>,
    /// Added to each row, `[width]`.
    pub bias: Option<Tensor<1>>,
    /// Gain and shift, `[width]`, after normalisation to zero mean and unit variance, and the constant that
    /// is added to variances.
    pub norm: Option<(Tensor<1>, Option<Tensor<1>>, f32)>,
    /// Whether negative numbers become 0.
    pub relu: bool,
    /// Factors of the rows, `[n, 1]`.
    pub factors: Option<Tensor<2>>,
}

/// Applies a pass to the rows of a matrix. Returns a matrix `[rows, width]`.
///
/// # Panics
/// If shapes do not fit together.
pub(crate) fn pass(x: Tensor<2>, pass: RowPass) -> Tensor<2> {
    let RowPass { weights, added, bias, norm, relu, factors } = pass;
    let (device, [rows, k]) = (x.device(), x.dims());
    let width = weights.as_ref().map_or(k, |weights| weights.dims()[1]);
    assert!(weights.as_ref().is_none_or(|weights| weights.dims()[0] == k), "weights for {k} columns");
    for added in &added {
        let [m, columns] = added.dims();
        assert!(
            columns == width && (m == rows || m > 0 && rows.is_multiple_of(m)),
            "[{m}, {columns}] to [{rows}, {width}]"
        );
    }
    let vector = |x: Option<Tensor<1>>| {
        let numbers = x.map(Numbers::of);
        assert!(
            numbers.as_ref().is_none_or(|numbers| numbers.slice().len() == width),
            "a vector of the width"
        );
        numbers
    };
    let (epsilon, gain, shift) = match norm {
        Some((gain, shift, epsilon)) => (epsilon, vector(Some(gain)), vector(shift)),
        None => (0.0, None, None),
    };
    let added: Vec<Numbers> = added.into_iter().map(Numbers::of).collect();
    let (bias, factors) = (vector(bias), factors.map(Numbers::of));
    assert!(factors.as_ref().is_none_or(|f| f.slice().len() == rows), "a factor for each row");
    let added: Vec<&[f32]> = added.iter().map(Numbers::slice).collect();

    // A product is written to its own memory, other rows where they are if nothing else refers to them.
    let (product_of, mut out) = match weights {
        Some(weights) => {
            let product = TensorData::new(vec![0.0_f32; rows * width], [rows, width]);
            (Some((Numbers::of(x), Numbers::of(weights))), product)
        }
        None => (None, Numbers::own(x)),
    };
    let finish = Finish {
        width,
        bias: bias.as_ref().map(Numbers::slice),
        norm: gain.as_ref().map(|gain| Norm {
            gain: gain.slice(),
            shift: shift.as_ref().map(Numbers::slice),
            epsilon,
        }),
        relu,
    };
    let follow = Follow { finish: &finish, added: &added, factors: factors.as_ref().map(Numbers::slice) };
    if width > 0 {
        let arch = Arch::new();
        let product_of = product_of.as_ref();
        let product_of =
            product_of.map(|(x, weights)| (x.slice(), Weights::new(weights.slice(), width, rows)));
        let out = out.as_mut_slice().expect("32-bit floating-point numbers");
        for (block, out) in out.chunks_mut(BLOCK_ROWS * width).enumerate() {
            let first = block * BLOCK_ROWS;
            if let Some((x, weights)) = &product_of {
                arch.dispatch(Product { weights, x: &x[first * k..][..out.len() / width * k], out });
            }
            arch.dispatch(Rows { follow: &follow, first, rows: out });
        }
    }
    Tensor::from_data(out, &device)
}

/// The operations after the product, as slices.
struct Follow<'a> {
    finish: &'a Finish<'a>,
    added: &'a [&'a [f32]],
    factors: Option<&'a [f32]>,
}

/// Bias, norm and activation of rows, in this order.
pub(crate) struct Finish<'a> {
    /// Number of columns.
    pub width: usize,
    /// Added to each row, `[width]`.
    pub bias: Option<&'a [f32]>,
    /// Layer norm.
    pub norm: Option<Norm<'a>>,
    /// Whether negative numbers become 0.
    pub relu: bool,
}

/// A layer norm.
pub(crate) struct Norm<'a> {
    /// Gain, `[width]`.
    pub gain: &'a [f32],
    /// Shift, `[width]`.
    pub shift: Option<&'a [f32]>,
    /// Added to variances.
    pub epsilon: f32,
}

/// Rows, of which the first has this number, and what is done to them.
struct Rows<'a, 'b> {
    follow: &'a Follow<'a>,
    first: usize,
    rows: &'b mut [f32],
}

impl WithSimd for Rows<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.follow.apply(self.first, self.rows);
    }
}

impl Follow<'_> {
    #[inline(always)]
    fn apply(&self, first: usize, rows: &mut [f32]) {
        let width = self.finish.width;
        for (group, rows) in rows.chunks_mut(TOGETHER * width).enumerate() {
            let numbers = first + group * TOGETHER..;
            for (i, row) in numbers.clone().zip(rows.chunks_exact_mut(width)) {
                for added in self.added {
                    add(row, &added[(i * width) % added.len()..][..width]);
                }
            }
            self.finish.apply(rows);
            if let Some(factors) = self.factors {
                for (i, row) in numbers.zip(rows.chunks_exact_mut(width)) {
                    let factor = factors[i];
                    for x in row {
                        *x *= factor;
                    }
                }
            }
        }
    }
}

impl Finish<'_> {
    /// Applies the operations to all rows.
    pub(crate) fn apply_all(&self, rows: &mut [f32]) {
        if self.width > 0 {
            Arch::new().dispatch(Rows {
                follow: &Follow { finish: self, added: &[], factors: None },
                first: 0,
                rows,
            });
        }
    }

    /// Applies the operations to at most [`TOGETHER`] rows.
    #[inline(always)]
    fn apply(&self, rows: &mut [f32]) {
        if let Some(bias) = self.bias {
            for row in rows.chunks_exact_mut(self.width) {
                add(row, bias);
            }
        }
        if let Some(norm) = &self.norm {
            normalize(rows, norm.gain, norm.epsilon);
            if let Some(shift) = norm.shift {
                for row in rows.chunks_exact_mut(self.width) {
                    add(row, shift);
                }
            }
        }
        if self.relu {
            for x in rows {
                // NaN stays.
                *x = if *x < 0.0 { 0.0 } else { *x };
            }
        }
    }
}

#[inline(always)]
fn add(row: &mut [f32], other: &[f32]) {
    let other = &other[..row.len()];
    for i in 0..row.len() {
        row[i] += other[i];
    }
}

/// Normalises at most [`TOGETHER`] rows as wide as the gain.
#[inline(always)]
fn normalize(rows: &mut [f32], gain: &[f32], epsilon: f32) {
    let share = 1.0 / gain.len() as f32;
    let mut sums = [[0.0; LANES]; TOGETHER];
    for (row, sums) in rows.chunks_exact(gain.len()).zip(&mut sums) {
        *sums = partial_sums(row, |x| x);
    }
    let means = totals(&sums).map(|sum| sum * share);
    for (i, row) in rows.chunks_exact(gain.len()).enumerate() {
        sums[i] = partial_sums(row, |x| (x - means[i]) * (x - means[i]));
    }
    let factors = totals(&sums).map(|sum| 1.0 / (sum * share + epsilon).sqrt());
    for (i, row) in rows.chunks_exact_mut(gain.len()).enumerate() {
        for k in 0..row.len() {
            row[k] = (row[k] - means[i]) * factors[i] * gain[k];
        }
    }
}

/// Adds up the terms of a row, each [`LANES`]-th in a sum of its own.
#[inline(always)]
pub(super) fn sum(row: &[f32], term: impl Fn(f32) -> f32) -> f32 {
    totals(&[partial_sums(row, term)])[0]
}

/// Returns sums of the terms of a row, each of every [`LANES`]-th term.
#[inline(always)]
fn partial_sums(row: &[f32], term: impl Fn(f32) -> f32) -> [f32; LANES] {
    let mut sums = [0.0; LANES];
    let (blocks, rest) = row.as_chunks::<LANES>();
    for block in blocks {
        for i in 0..LANES {
            sums[i] += term(block[i]);
        }
    }
    for i in 0..rest.len() {
        sums[i] += term(rest[i]);
    }
    sums
}

/// Returns N sums of [`LANES`] numbers each. Additions of one sum wait for one another; other sums go on
/// meanwhile.
#[inline(always)]
pub(super) fn totals<const N: usize>(parts: &[[f32; LANES]; N]) -> [f32; N] {
    let mut totals = [0.0; N];
    for lane in 0..LANES {
        for i in 0..N {
            totals[i] += parts[i][lane];
        }
    }
    totals
}

/// Returns the element-wise maximum of the rows of each group, `[n, width]`, of groups `[n, each, width]`.
///
/// # Panics
/// If groups have no rows.
pub(crate) fn largest(groups: Tensor<3>) -> Tensor<2> {
    let (device, [n, each, width]) = (groups.device(), groups.dims());
    assert!(each > 0, "rows in groups");
    let numbers = Numbers::of(groups);
    let mut out = Vec::with_capacity(n * width);
    for group in numbers.slice().chunks_exact((each * width).max(1)) {
        let (first, others) = group.split_at(width);
        let begin = out.len();
        out.extend_from_slice(first);
        for other in others.chunks_exact(width) {
            Arch::new().dispatch(Maximum { out: &mut out[begin..], other });
        }
    }
    Tensor::from_data(TensorData::new(out, [n, width]), &device)
}

/// Gathers places of each sequence, `[n, places, width]`, into `[n * index, width]`; those that are `None`
/// are 0.
pub(crate) fn gather(x: Tensor<3>, index: &[Option<usize>]) -> Tensor<2> {
    let (device, [n, places, width]) = (x.device(), x.dims());
    let (numbers, zeros) = (Numbers::of(x), vec![0.0; width]);
    let mut rows = Vec::with_capacity(n * index.len() * width);
    for sequence in numbers.slice().chunks_exact((places * width).max(1)) {
        for at in index {
            rows.extend_from_slice(at.map_or(&zeros, |at| &sequence[at * width..][..width]));
        }
    }
    Tensor::from_data(TensorData::new(rows, [n * index.len(), width]), &device)
}

struct Maximum<'a> {
    out: &'a mut [f32],
    other: &'a [f32],
}

impl WithSimd for Maximum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { out, other } = self;
        for i in 0..out.len() {
            // NaN counts as larger than any number, so that it is not lost.
            out[i] = if other[i] <= out[i] || out[i].is_nan() { out[i] } else { other[i] };
        }
    }
}
