//! Softmax attention of several heads in one pass.

use burn::tensor::{Tensor, TensorData};
use pulp::{Arch, Simd, WithSimd};

use super::rows::totals;
use super::softmax::partial_weights;
use super::{LANES, Numbers};

/// Queries that are computed together, so that keys and values are read once for all of them.
const TOGETHER: usize = 8;

/// Input of [`attend`]: `scenes` scenes of m queries and n keys each.
pub(crate) struct Attention {
    /// Number of scenes.
    pub scenes: usize,
    /// Number of heads.
    pub heads: usize,
    /// Queries `[scenes * m, heads * d]` and keys `[scenes * n, heads * d]`, whose products are added up;
    /// d may differ from pair to pair.
    pub products: Vec<(Tensor<2>, Tensor<2>)>,
    /// Factor on the sum of the products.
    pub scale: f32,
    /// `[scenes or 1, 1, m or 1, n or 1]`: added to the scores.
    pub closed: Tensor<4>,
    /// Values `[scenes * n, heads * v]`.
    pub values: Tensor<2>,
}

/// Returns the means of the values weighted by the softmax of the scores, `[scenes * m, heads * v]`.
///
/// A key whose score is more than 80 below the largest one of its query has weight 0.
///
/// # Panics
/// If there are no keys, or the shapes do not fit together.
pub(crate) fn attend(input: Attention) -> Tensor<2> {
    let Attention { scenes, heads, products, scale, closed, values } = input;
    let device = values.device();
    let rows = products[0].0.dims()[0];
    let sizes = Sizes { heads, m: rows / scenes, n: values.dims()[0] / scenes, v: values.dims()[1] / heads };
    let depths: Vec<usize> = products.iter().map(|(queries, _)| queries.dims()[1] / heads).collect();
    for ((queries, keys), d) in products.iter().zip(&depths) {
        assert_eq!((queries.dims(), keys.dims()), ([rows, heads * d], [scenes * sizes.n, heads * d]));
    }
    let mask_shape = closed.dims();
    let fits = [scenes, 1, sizes.m, sizes.n].into_iter().zip(mask_shape);
    assert!(fits.clone().all(|(size, mask)| mask == 1 || mask == size), "a mask of {mask_shape:?}");

    let products: Vec<_> = products.into_iter().map(|(q, k)| (Numbers::of(q), Numbers::of(k))).collect();
    let (values, closed) = (Numbers::of(values), Numbers::of(closed));
    let mut out = vec![0.0; rows * heads * sizes.v];
    Arch::new().dispatch(Pass {
        sizes,
        products: products.iter().zip(depths).map(|((q, k), d)| (q.slice(), k.slice(), d)).collect(),
        scale,
        closed: closed.slice(),
        mask_shape,
        values: values.slice(),
        out: &mut out,
    });
    Tensor::from_data(TensorData::new(out, [rows, heads * sizes.v]), &device)
}

#[derive(Clone, Copy)]
struct Sizes {
    heads: usize,
    /// Queries per scene.
    m: usize,
    /// Keys per scene.
    n: usize,
    /// Width of a value.
    v: usize,
}

/// [`Attention`] as slices, row by row.
struct Pass<'a> {
    sizes: Sizes,
    /// Queries, keys and their width per head.
    products: Vec<(&'a [f32], &'a [f32], usize)>,
    scale: f32,
    closed: &'a [f32],
    mask_shape: [usize; 4],
    values: &'a [f32],
    out: &'a mut [f32],
}

/// One head of one scene, laid out for vector units.
struct Head {
    /// A row per depth, with a column per key.
    keys: Padded,
    /// A row per key.
    values: Padded,
    /// A row per query: scores, then weights. A column per key.
    scores: Padded,
    /// A row per depth, with a column per query.
    queries: Vec<[f32; TOGETHER]>,
}

/// A matrix whose rows are padded to a multiple of [`LANES`].
struct Padded {
    numbers: Vec<f32>,
    width: usize,
}

impl Padded {
    fn new(rows: usize, columns: usize) -> Self {
        let width = columns.next_multiple_of(LANES);
        Self { numbers: vec![0.0; rows * width], width }
    }

    #[inline(always)]
    fn row(&self, row: usize) -> &[f32] {
        &self.numbers[row * self.width..][..self.width]
    }

    #[inline(always)]
    fn row_mut(&mut self, row: usize) -> &mut [f32] {
        &mut self.numbers[row * self.width..][..self.width]
    }
}

impl WithSimd for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let Sizes { heads, m, n, v } = self.sizes;
        let depth = self.products.iter().map(|p| p.2).sum();
        let mut head = Head {
            keys: Padded::new(depth, n),
            values: Padded::new(n, v),
            scores: Padded::new(TOGETHER, n),
            queries: vec![[0.0; TOGETHER]; depth],
        };
        let out = std::mem::take(&mut self.out);
        for (scene, out) in out.chunks_exact_mut(m * heads * v).enumerate() {
            for h in 0..heads {
                self.read_keys(scene, h, &mut head.keys);
                self.read_values(scene, h, &mut head.values);
                for first in (0..m).step_by(TOGETHER) {
                    let count = TOGETHER.min(m - first);
                    self.read_queries(scene * m + first, count, h, &mut head.queries);
                    score(simd, &head.queries, &head.keys, &mut head.scores);
                    let mut sums = [[0.0; LANES]; TOGETHER];
                    for (i, sums) in sums.iter_mut().enumerate().take(count) {
                        let scores = head.scores.row_mut(i);
                        self.close(scene, first + i, scores);
                        *sums = partial_weights(scores);
                    }
                    let factors = totals(&sums).map(|sum| 1.0 / sum);
                    for block in (0..v).step_by(LANES) {
                        let sums = mix(simd, &head.scores, &head.values, block, n);
                        for i in 0..count {
                            let row = &mut out[((first + i) * heads + h) * v + block..];
                            for k in 0..LANES.min(v - block) {
                                row[k] = sums[i][k] * factors[i];
                            }
                        }
                    }
                }
            }
        }
    }
}

impl Pass<'_> {
    #[inline(always)]
    fn read_keys(&self, scene: usize, h: usize, to: &mut Padded) {
        let Sizes { heads, n, .. } = self.sizes;
        let mut depth = 0;
        for (_, keys, d) in &self.products {
            for j in 0..n {
                let key = &keys[((scene * n + j) * heads + h) * d..][..*d];
                for i in 0..*d {
                    to.numbers[(depth + i) * to.width + j] = key[i];
                }
            }
            depth += d;
        }
    }

    #[inline(always)]
    fn read_values(&self, scene: usize, h: usize, to: &mut Padded) {
        let Sizes { heads, n, v, .. } = self.sizes;
        for j in 0..n {
            let value = &self.values[((scene * n + j) * heads + h) * v..][..v];
            to.row_mut(j)[..v].copy_from_slice(value);
        }
    }

    #[inline(always)]
    fn read_queries(&self, first: usize, count: usize, h: usize, to: &mut [[f32; TOGETHER]]) {
        let mut depth = 0;
        for (queries, _, d) in &self.products {
            for i in 0..count {
                let query = &queries[((first + i) * self.sizes.heads + h) * d..][..*d];
                for k in 0..*d {
                    to[depth + k][i] = query[k] * self.scale;
                }
            }
            depth += d;
        }
    }

    /// Adds the mask to the scores of a query and closes the padding.
    #[inline(always)]
    fn close(&self, scene: usize, query: usize, scores: &mut [f32]) {
        let [scenes, _, rows, columns] = self.mask_shape;
        let row = (if scenes == 1 { 0 } else { scene }) * rows + if rows == 1 { 0 } else { query };
        let mask = &self.closed[row * columns..][..columns];
        let (used, padding) = scores.split_at_mut(self.sizes.n);
        if columns == 1 {
            for score in used {
                *score += mask[0];
            }
        } else {
            for j in 0..columns {
                used[j] += mask[j];
            }
        }
        padding.fill(f32::NEG_INFINITY);
    }
}

/// Computes the scores of [`TOGETHER`] queries.
#[inline(always)]
fn score<S: Simd>(simd: S, queries: &[[f32; TOGETHER]], keys: &Padded, scores: &mut Padded) {
    for j in 0..keys.width / S::F32_LANES {
        let mut sums = [simd.splat_f32s(0.0); TOGETHER];
        for (depth, query) in queries.iter().enumerate() {
            let key = S::as_simd_f32s(keys.row(depth)).0[j];
            for i in 0..TOGETHER {
                sums[i] = simd.mul_add_e_f32s(simd.splat_f32s(query[i]), key, sums[i]);
            }
        }
        for i in 0..TOGETHER {
            S::as_mut_simd_f32s(scores.row_mut(i)).0[j] = sums[i];
        }
    }
}

/// Returns sums of weighted values of [`TOGETHER`] queries: a block of columns that begins at `block`.
#[inline(always)]
fn mix<S: Simd>(
    simd: S,
    weights: &Padded,
    values: &Padded,
    block: usize,
    keys: usize,
) -> [[f32; LANES]; TOGETHER] {
    let mut out = [[0.0; LANES]; TOGETHER];
    for k in 0..LANES / S::F32_LANES {
        let mut sums = [simd.splat_f32s(0.0); TOGETHER];
        for j in 0..keys {
            let value = S::as_simd_f32s(&values.row(j)[block..]).0[k];
            for i in 0..TOGETHER {
                let weight = simd.splat_f32s(weights.numbers[i * weights.width + j]);
                sums[i] = simd.mul_add_e_f32s(weight, value, sums[i]);
            }
        }
        for i in 0..TOGETHER {
            S::as_mut_simd_f32s(&mut out[i]).0[k] = sums[i];
        }
    }
    out
}
