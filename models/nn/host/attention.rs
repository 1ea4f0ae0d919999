//! Softmax attention of several heads in one pass.

use burn::tensor::{Tensor, TensorData};
use pulp::{Arch, Simd, WithSimd};

use super::softmax::{exp, larger};
use super::{LANES, Numbers};

/// Number of sums that are computed at the same time to keep a processor busy: scores of as many keys, and
/// mixed values of as many queries.
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

/// Numbers of [`LANES`] queries, which are computed together, so that keys and values are read once for all
/// of them.
type OfQueries = [f32; LANES];

/// One head of one scene, laid out for vector units.
struct Head {
    /// By depth; 0 for queries beyond the last.
    queries: Vec<OfQueries>,
    /// Scores, then weights, by key.
    scores: Vec<OfQueries>,
    /// A row per key, padded to a multiple of [`LANES`].
    values: Vec<[f32; LANES]>,
}

impl WithSimd for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let Sizes { heads, m, n, v } = self.sizes;
        let depth = self.products.iter().map(|p| p.2).sum();
        let blocks = v.div_ceil(LANES);
        let mut head = Head {
            queries: vec![[0.0; LANES]; depth],
            scores: vec![[0.0; LANES]; n],
            values: vec![[0.0; LANES]; n * blocks],
        };
        let mut masks = Vec::new();
        let out = std::mem::take(&mut self.out);
        for (scene, out) in out.chunks_exact_mut(m * heads * v).enumerate() {
            if scene == 0 || self.mask_shape[0] > 1 {
                self.read_masks(scene, &mut masks);
            }
            for h in 0..heads {
                self.read_values(scene, h, &mut head.values);
                for first in (0..m).step_by(LANES) {
                    let count = LANES.min(m - first);
                    self.read_queries(scene * m + first, count, h, &mut head.queries);
                    self.score(simd, scene, h, &head.queries, &mut head.scores);
                    self.close(&masks, first, &mut head.scores);
                    let factors = weigh(&mut head.scores);
                    for query in (0..count).step_by(TOGETHER) {
                        for block in 0..blocks {
                            let sums = mix(simd, &head.scores, query, &head.values, block, blocks);
                            for i in 0..TOGETHER.min(count - query) {
                                let begin = ((first + query + i) * heads + h) * v + block * LANES;
                                let row = &mut out[begin..][..LANES.min(v - block * LANES)];
                                for k in 0..row.len() {
                                    row[k] = sums[i][k] * factors[query + i];
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

impl Pass<'_> {
    /// Reads the numbers that are added to scores: by group of [`LANES`] queries, with one group if they do not
    /// depend on the query, then by key.
    #[inline(always)]
    fn read_masks(&self, scene: usize, to: &mut Vec<OfQueries>) {
        let [_, _, rows, columns] = self.mask_shape;
        let masks = &self.closed[scene * rows * columns..][..rows * columns];
        to.clear();
        if rows == 1 {
            to.extend(masks.iter().map(|mask| [*mask; LANES]));
            return;
        }
        for first in (0..rows).step_by(LANES) {
            let begin = to.len();
            to.resize(begin + columns, [0.0; LANES]);
            for i in 0..LANES.min(rows - first) {
                let row = &masks[(first + i) * columns..][..columns];
                for (to, mask) in to[begin..].iter_mut().zip(row) {
                    to[i] = *mask;
                }
            }
        }
    }

    #[inline(always)]
    fn read_values(&self, scene: usize, h: usize, to: &mut [[f32; LANES]]) {
        let Sizes { heads, n, v, .. } = self.sizes;
        for (j, to) in to.chunks_exact_mut(v.div_ceil(LANES).max(1)).enumerate() {
            let value = &self.values[((scene * n + j) * heads + h) * v..][..v];
            let (blocks, rest) = value.as_chunks();
            for i in 0..blocks.len() {
                to[i] = blocks[i];
            }
            for k in 0..rest.len() {
                to[blocks.len()][k] = rest[k];
            }
        }
    }

    #[inline(always)]
    fn read_queries(&self, first: usize, count: usize, h: usize, to: &mut [OfQueries]) {
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

    /// Computes the scores of [`LANES`] queries.
    #[inline(always)]
    fn score<S: Simd>(
        &self,
        simd: S,
        scene: usize,
        h: usize,
        queries: &[OfQueries],
        scores: &mut [OfQueries],
    ) {
        let n = self.sizes.n;
        let mut j = 0;
        while j < n {
            j += match n - j {
                TOGETHER.. => {
                    self.scores_of::<S, TOGETHER>(simd, scene * n + j, h, queries, &mut scores[j..])
                }
                _ => self.scores_of::<S, 1>(simd, scene * n + j, h, queries, &mut scores[j..]),
            };
        }
    }

    /// Computes the scores for K keys. Returns K.
    #[inline(always)]
    fn scores_of<S: Simd, const K: usize>(
        &self,
        simd: S,
        first: usize,
        h: usize,
        queries: &[OfQueries],
        scores: &mut [OfQueries],
    ) -> usize {
        for part in 0..LANES / S::F32_LANES {
            let mut sums = [simd.splat_f32s(0.0); K];
            let mut depth = 0;
            for (_, keys, d) in &self.products {
                let mut rows: [&[f32]; K] = [&[]; K];
                for k in 0..K {
                    rows[k] = &keys[((first + k) * self.sizes.heads + h) * d..][..*d];
                }
                for i in 0..*d {
                    let query = S::as_simd_f32s(&queries[depth + i]).0[part];
                    for k in 0..K {
                        sums[k] = simd.mul_add_e_f32s(query, simd.splat_f32s(rows[k][i]), sums[k]);
                    }
                }
                depth += d;
            }
            for k in 0..K {
                S::as_mut_simd_f32s(&mut scores[k]).0[part] = sums[k];
            }
        }
        K
    }

    /// Adds the masks to the scores of queries.
    #[inline(always)]
    fn close(&self, masks: &[OfQueries], first: usize, scores: &mut [OfQueries]) {
        let [_, _, rows, columns] = self.mask_shape;
        let masks = &masks[if rows == 1 { 0 } else { first / LANES * columns }..][..columns];
        for j in 0..scores.len() {
            let mask = if columns == 1 { &masks[0] } else { &masks[j] };
            for i in 0..LANES {
                scores[j][i] += mask[i];
            }
        }
    }
}

/// Replaces scores by weights e^(score - largest). Returns the factor of each query that makes its weights add
/// up to 1.
#[inline(always)]
fn weigh(scores: &mut [OfQueries]) -> OfQueries {
    let mut largest = [f32::NEG_INFINITY; LANES];
    for score in scores.iter() {
        for i in 0..LANES {
            largest[i] = larger(score[i], largest[i]);
        }
    }
    // As many sums per query, so that additions do not wait for one another.
    let mut sums = [[0.0; LANES]; LANES];
    for scores in scores.chunks_mut(LANES) {
        for (scores, sums) in scores.iter_mut().zip(&mut sums) {
            for i in 0..LANES {
                scores[i] = exp(scores[i] - largest[i]);
                sums[i] += scores[i];
            }
        }
    }
    let mut total = [0.0; LANES];
    for sums in sums {
        for i in 0..LANES {
            total[i] += sums[i];
        }
    }
    total.map(|sum| 1.0 / sum)
}

/// Returns sums of weighted values of [`TOGETHER`] queries, from this one on: a block of columns.
#[inline(always)]
fn mix<S: Simd>(
    simd: S,
    weights: &[OfQueries],
    query: usize,
    values: &[[f32; LANES]],
    block: usize,
    blocks: usize,
) -> [[f32; LANES]; TOGETHER] {
    let mut out = [[0.0; LANES]; TOGETHER];
    for part in 0..LANES / S::F32_LANES {
        let mut sums = [simd.splat_f32s(0.0); TOGETHER];
        for (weights, values) in weights.iter().zip(values.chunks_exact(blocks)) {
            let value = S::as_simd_f32s(&values[block]).0[part];
            let weights = &weights[query..][..TOGETHER];
            for i in 0..TOGETHER {
                sums[i] = simd.mul_add_e_f32s(simd.splat_f32s(weights[i]), value, sums[i]);
            }
        }
        for i in 0..TOGETHER {
            S::as_mut_simd_f32s(&mut out[i]).0[part] = sums[i];
        }
    }
    out
}
