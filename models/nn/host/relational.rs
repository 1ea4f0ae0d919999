//! Attention to neighbours with relation vectors in one pass.

use burn::tensor::{Device, Tensor, TensorData};
use pulp::{Arch, Simd, WithSimd};

use super::rows::totals;
use super::softmax::partial_weights;
use super::{LANES, Numbers, slice};

/// Slots of the neighbours of N destinations: K per destination, of which some are open.
pub(crate) struct Slots<'a> {
    /// Number of slots per destination.
    pub per_destination: usize,
    /// Row of the source of each slot, `[N * K]`.
    pub sources: &'a [u32],
    /// Row of the relation of each slot, `[N * K]`.
    pub relations: &'a [u32],
    /// Whether a slot is open, `[N * K]`.
    pub open: &'a [bool],
}

/// Computes the attention of every destination and head to the open slots of the destination. The score of a
/// slot is the product of a row of `to_sources`, `[heads, N, h]`, with the features of its source, plus that
/// of a row of `to_relations`, `[heads, N, r]`, with its relation vector. Returns the sums of sources,
/// `[heads, N, h]`, and of relations, `[heads, N, r]`, weighted by the softmax of the scores; zeros for a
/// destination without open slots.
///
/// `sources` is `[M, h]`, `relations` are the vectors of edges, `[E, r]`.
///
/// # Panics
/// If the shapes do not fit together or a slot has no source or relation.
pub(crate) fn attend_to_neighbors(
    to_sources: Tensor<3>,
    to_relations: Tensor<3>,
    sources: Tensor<2>,
    relations: &TensorData,
    slots: &Slots<'_>,
) -> (Tensor<3>, Tensor<3>) {
    let device: Device = sources.device();
    let ([heads, n, h], r) = (to_sources.dims(), to_relations.dims()[2]);
    assert_eq!(to_relations.dims(), [heads, n, r]);
    assert_eq!(sources.dims()[1], h);
    let all = n * slots.per_destination;
    assert_eq!((slots.sources.len(), slots.relations.len(), slots.open.len()), (all, all, all));
    let [queries, relation_queries] = [to_sources, to_relations].map(Numbers::of);
    let sources = Numbers::of(sources);
    let mut sums = vec![0.0; n * heads * h];
    let mut relation_sums = vec![0.0; n * heads * r];
    Arch::new().dispatch(Pass {
        heads,
        destinations: n,
        slots,
        parts: [
            Part { width: h, queries: queries.slice(), rows: sources.slice(), of: slots.sources },
            Part { width: r, queries: relation_queries.slice(), rows: slice(relations), of: slots.relations },
        ],
        out: [&mut sums, &mut relation_sums],
    });
    let tensor = |sums: Vec<f32>, width: usize| {
        Tensor::<3>::from_data(TensorData::new(sums, [heads, n, width]), &device)
    };
    (tensor(sums, h), tensor(relation_sums, r))
}

/// Sources or relations: the rows that slots refer to, and the queries that are multiplied with them.
#[derive(Clone, Copy)]
struct Part<'a> {
    width: usize,
    queries: &'a [f32],
    rows: &'a [f32],
    /// Row of each slot.
    of: &'a [u32],
}

struct Pass<'a> {
    heads: usize,
    destinations: usize,
    slots: &'a Slots<'a>,
    parts: [Part<'a>; 2],
    out: [&'a mut [f32]; 2],
}

impl WithSimd for Pass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (heads, k) = (self.heads, self.slots.per_destination);
        if k == 0 {
            return;
        }
        let mut open = Vec::with_capacity(k);
        let mut scores = Vec::new();
        for n in 0..self.destinations {
            open.clear();
            open.extend((n * k..(n + 1) * k).filter(|&slot| self.slots.open[slot]));
            if open.is_empty() {
                continue;
            }
            let width = open.len().next_multiple_of(LANES);
            scores.clear();
            scores.resize(heads * width, 0.0);
            // Heads are computed together, so that each row is read once.
            let mut first = 0;
            while first < heads {
                let left = heads - first;
                let scores = &mut scores[first * width..];
                first += match left {
                    8.. => self.heads::<S, 8>(simd, (first, n), &open, scores, width),
                    4.. => self.heads::<S, 4>(simd, (first, n), &open, scores, width),
                    _ => self.heads::<S, 1>(simd, (first, n), &open, scores, width),
                };
            }
        }
    }
}

impl Pass<'_> {
    /// Computes the next H heads of a destination from the first of them on. Returns H.
    #[inline(always)]
    fn heads<S: Simd, const H: usize>(
        &mut self,
        simd: S,
        (first, destination): (usize, usize),
        open: &[usize],
        scores: &mut [f32],
        width: usize,
    ) -> usize {
        let [sources, relations] = self.parts;
        let count = self.destinations;
        let row = first * count + destination;
        for (i, &slot) in open.iter().enumerate() {
            let mut sums = [simd.splat_f32s(0.0); H];
            let mut tails = [0.0; H];
            for part in [sources, relations] {
                let queries = &part.queries[row * part.width..];
                let key = &part.rows[part.of[slot] as usize * part.width..][..part.width];
                add_products::<S, H>(simd, queries, count * part.width, key, &mut sums, &mut tails);
            }
            for head in 0..H {
                scores[head * width + i] = simd.reduce_sum_f32s(sums[head]) + tails[head];
            }
        }
        let mut sums = [[0.0; LANES]; H];
        for head in 0..H {
            let scores = &mut scores[head * width..][..width];
            scores[open.len()..].fill(f32::NEG_INFINITY);
            sums[head] = partial_weights(scores);
        }
        let factors = totals(&sums).map(|sum| 1.0 / sum);
        for (part, out) in self.parts.into_iter().zip(&mut self.out) {
            let out = &mut out[row * part.width..];
            mix::<S, H>(simd, &part, open, scores, width, factors, (out, count * part.width));
        }
        H
    }
}

/// Adds the products of H queries, which begin every `stride` numbers, with a key: whole registers to `sums`,
/// the rest to `tails`.
#[inline(always)]
fn add_products<S: Simd, const H: usize>(
    simd: S,
    queries: &[f32],
    stride: usize,
    key: &[f32],
    sums: &mut [S::f32s; H],
    tails: &mut [f32; H],
) {
    let width = key.len();
    let whole = width / S::F32_LANES * S::F32_LANES;
    let (key, tail) = key.split_at(whole);
    let (key, _) = S::as_simd_f32s(key);
    let mut own = [key; H];
    for head in 0..H {
        own[head] = S::as_simd_f32s(&queries[head * stride..][..whole]).0;
    }
    for j in 0..key.len() {
        for head in 0..H {
            sums[head] = simd.mul_add_e_f32s(own[head][j], key[j], sums[head]);
        }
    }
    for j in 0..tail.len() {
        for head in 0..H {
            tails[head] += queries[head * stride + whole + j] * tail[j];
        }
    }
}

/// Writes the sums of the rows of open slots for H heads, weighted and multiplied by a factor per head. Sums
/// of heads begin every `stride` numbers.
#[inline(always)]
fn mix<S: Simd, const H: usize>(
    simd: S,
    part: &Part<'_>,
    open: &[usize],
    weights: &[f32],
    width: usize,
    factors: [f32; H],
    (out, stride): (&mut [f32], usize),
) {
    let row = |slot: usize| S::as_simd_f32s(&part.rows[part.of[slot] as usize * part.width..][..part.width]);
    let lanes = S::F32_LANES;
    let whole = part.width / lanes;
    for j in 0..whole {
        let mut sums = [simd.splat_f32s(0.0); H];
        for (i, &slot) in open.iter().enumerate() {
            let numbers = row(slot).0[j];
            for head in 0..H {
                let weight = simd.splat_f32s(weights[head * width + i]);
                sums[head] = simd.mul_add_e_f32s(weight, numbers, sums[head]);
            }
        }
        for head in 0..H {
            let out = &mut out[head * stride + j * lanes..][..lanes];
            S::as_mut_simd_f32s(out).0[0] = simd.mul_f32s(sums[head], simd.splat_f32s(factors[head]));
        }
    }
    for head in 0..H {
        for j in 0..part.width - whole * lanes {
            let mut sum = 0.0;
            for (i, &slot) in open.iter().enumerate() {
                sum += weights[head * width + i] * row(slot).1[j];
            }
            out[head * stride + whole * lanes + j] = sum * factors[head];
        }
    }
}
